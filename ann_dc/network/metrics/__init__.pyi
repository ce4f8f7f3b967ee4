from .contract import Kind as Kind, Row as Row, Wires as Wires
from .grid import Grid as Grid
from .time_constants import TimeConstants as TimeConstants
from .tree import Tree as Tree
