from .contract import (
    ALL_KINDS as ALL_KINDS,
    Factors as Factors,
    Kind as Kind,
    Metric as Metric,
    Row as Row,
    Wires as Wires,
)
from .elimination import Elimination as Elimination, Level as Level, eliminate as eliminate
from .grid import Grid as Grid
from .pyramid import Pyramid as Pyramid, hat_positions as hat_positions
from .stiffness import Stiffness as Stiffness
from .time_constants import TimeConstants as TimeConstants
from .tree import Tree as Tree
