from .golden import FixedPoint as FixedPoint, Port as Port, fixed_point as fixed_point
from .machine import Integers as Integers, Machine as Machine
