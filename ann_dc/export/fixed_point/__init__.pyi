from .arithmetic import Integers as Integers, Machine as Machine
from .c99 import c99_check as c99_check, c99_files as c99_files
from .golden import FixedPoint as FixedPoint, Measured as Measured, Port as Port
from .hdl import hdl_check as hdl_check, hdl_files as hdl_files
from .widths import fixed_point as fixed_point
