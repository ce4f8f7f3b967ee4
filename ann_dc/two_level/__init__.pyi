from .coordination import (
    COORDINATORS as COORDINATORS,
)
from .coordination import (
    Coordination as Coordination,
)
from .coordination import (
    Undesigned as Undesigned,
)
from .coordination import (
    best_gradient as best_gradient,
)
from .coordination import (
    coordinate as coordinate,
)
from .coordination import (
    newton as newton,
)
from .layer import TwoLevelLayer as TwoLevelLayer
from .lower_level import Closed as Closed
from .lower_level import Iterated as Iterated
from .lower_level import LowerLevel as LowerLevel
from .lyapunov import Lyapunov as Lyapunov
from .lyapunov import lyapunov_of as lyapunov_of
from .oracle_gain import OracleBackend as OracleBackend
from .oracle_gain import OracleGain as OracleGain
from .run import TwoLevelRun as TwoLevelRun
from .theorem import Hypothesis as Hypothesis
from .theorem import theorem_IV_2 as theorem_IV_2
from .upper_gains import UpperGains as UpperGains
from .upper_gains import UpperMap as UpperMap
from .upper_level import (
    Gradient as Gradient,
)
from .upper_level import (
    NewtonCoordinator as NewtonCoordinator,
)
from .upper_level import (
    OracleCoordinator as OracleCoordinator,
)
