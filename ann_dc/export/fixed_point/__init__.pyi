from .c99 import c99_check as c99_check, c99_files as c99_files
from .golden import FixedPoint as FixedPoint, Port as Port, fixed_point as fixed_point
from .machine import Integers as Integers, Machine as Machine
