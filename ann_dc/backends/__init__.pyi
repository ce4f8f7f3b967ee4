from . import ode as ode, recurrent as recurrent, spice as spice
from .batch import BatchRun as BatchRun
from .ode import (
    DOP853 as DOP853,
    METHODS as METHODS,
    OdeBackend as OdeBackend,
    RightHandSide as RightHandSide,
)
from .recorder import Recorder as Recorder
from .run import Backend as Backend, Run as Run
from .settling import Settling as Settling, last_exit as last_exit
from .status import (
    OVERFLOW as OVERFLOW,
    UNMET as UNMET,
    Outcome as Outcome,
    Status as Status,
    diverged as diverged,
    left_domain as left_domain,
    not_settled as not_settled,
    settled as settled,
)
from .trajectory import (
    Trajectory as Trajectory,
    control_error as control_error,
    controls_of as controls_of,
)
