from .coordination import (
    Coordination as Coordination,
    coordinate as coordinate,
)
from .levels import TwoLevels as TwoLevels
from .lower_level import Closed as Closed, Iterated as Iterated
from .lyapunov import (
    Distances as Distances,
    Lyapunov as Lyapunov,
    lyapunov_of as lyapunov_of,
    printed_of as printed_of,
)
from .oracle_gain import OracleBackend as OracleBackend, OracleGain as OracleGain
from .run import TwoLevelRun as TwoLevelRun
from .theorem import (
    PrintedMatrices as PrintedMatrices,
    StageHessians as StageHessians,
    theorem_IV_1 as theorem_IV_1,
    theorem_IV_2 as theorem_IV_2,
)
from .upper_gains import UpperMap as UpperMap
from .upper_level import (
    Gradient as Gradient,
    NewtonCoordinator as NewtonCoordinator,
    OracleCoordinator as OracleCoordinator,
)
