from .base import Kind as Kind, Row as Row, Wires as Wires
from .cyclic_reduction import Tree as Tree
from .diagonal import TimeConstants as TimeConstants
from .resistive_grid import Grid as Grid
