from .certificate import (
    LARGEST_RESIDUAL as LARGEST_RESIDUAL,
    Certificate as Certificate,
    certify as certify,
)
from .newton import newton_step as newton_step
from .reference_solvers import SolverTiming as SolverTiming, time_solvers as time_solvers
