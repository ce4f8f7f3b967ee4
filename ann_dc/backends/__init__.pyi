from . import ode as ode
from . import recurrent as recurrent
from . import spice as spice
from .batch import BatchRun as BatchRun
from .ode import (
    DOP853 as DOP853,
)
from .ode import (
    METHODS as METHODS,
)
from .ode import (
    OdeBackend as OdeBackend,
)
from .ode import (
    RightHandSide as RightHandSide,
)
from .recorder import Recorder as Recorder
from .run import Backend as Backend
from .run import Run as Run
from .settling import Settling as Settling
from .settling import last_exit as last_exit
from .status import (
    OVERFLOW as OVERFLOW,
)
from .status import (
    Outcome as Outcome,
)
from .status import (
    Status as Status,
)
from .status import (
    not_settled as not_settled,
)
from .status import (
    settled as settled,
)
from .trajectory import Trajectory as Trajectory
