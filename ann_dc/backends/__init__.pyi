from . import ode as ode, recurrent as recurrent, spice as spice
from .batch import BatchRun as BatchRun
from .batch_recorder import BatchCurves as BatchCurves, BatchRecorder as BatchRecorder
from .curves import (
    Curves as Curves,
    Tabulated as Tabulated,
    check_curves_file as check_curves_file,
    write_curves as write_curves,
)
from .integration.steppers import RightHandSide as RightHandSide
from .ode import (
    BATCHES as BATCHES,
    COMPILED as COMPILED,
    DOP853 as DOP853,
    METHODS as METHODS,
    OdeBackend as OdeBackend,
)
from .recorder import Recorder as Recorder
from .run import Backend as Backend, Run as Run
from .settling import (
    Settling as Settling,
    control_settling as control_settling,
    last_exit as last_exit,
)
from .status import (
    OVERFLOW as OVERFLOW,
    UNMET as UNMET,
    Outcome as Outcome,
    Status as Status,
    diverged as diverged,
    infeasible as infeasible,
    left_domain as left_domain,
    not_settled as not_settled,
    settled as settled,
    stalled as stalled,
    stopped as stopped,
    unbounded as unbounded,
)
from .trajectory import (
    Trajectory as Trajectory,
    control_error as control_error,
    control_values as control_values,
)
