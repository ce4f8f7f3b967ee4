from .cell import (
    ONE as ONE,
)
from .cell import (
    Block as Block,
)
from .cell import (
    Cell as Cell,
)
from .cell import (
    Connection as Connection,
)
from .cell import (
    Function as Function,
)
from .cell import (
    Limiter as Limiter,
)
from .cell import (
    Neuron as Neuron,
)
from .cell import (
    PIDual as PIDual,
)
from .cell import (
    Product as Product,
)
from .cell import (
    Role as Role,
)
from .cell import (
    Sum as Sum,
)
from .cell import (
    Template as Template,
)
from .checks import check_cell as check_cell
from .checks import per_stage as per_stage
from .coordinators import Coordinators as Coordinators
from .coordinators import hat_positions as hat_positions
from .ends import Absent as Absent
from .ends import Pin as Pin
from .functions import FUNCTIONS as FUNCTIONS
from .functions import Library as Library
from .functions import function_block as function_block
from .inputs import input_batch as input_batch
from .inputs import moved_starts as moved_starts
from .network import COORDINATION as COORDINATION
from .network import Network as Network
from .selection import EVERYWHERE as EVERYWHERE
from .selection import Known as Known
from .selection import Selection as Selection
