from .cell import (
    ONE as ONE,
    Block as Block,
    Cell as Cell,
    Connection as Connection,
    Function as Function,
    Limiter as Limiter,
    Neuron as Neuron,
    Product as Product,
    Role as Role,
    Sum as Sum,
    Template as Template,
)
from .checks import check_cell as check_cell, per_stage as per_stage
from .duals import (
    DiodeDual as DiodeDual,
    ObjectiveDual as ObjectiveDual,
    PIDual as PIDual,
)
from .ends import Absent as Absent, Pin as Pin
from .functions import FUNCTIONS as FUNCTIONS, Library as Library, function_block as function_block
from .inputs import input_batch as input_batch, moved_starts as moved_starts
from .network import COORDINATION as COORDINATION, Network as Network
from .selection import EVERYWHERE as EVERYWHERE, Known as Known, Selection as Selection
