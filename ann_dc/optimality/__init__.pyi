from .certificate import (
    LARGEST_RESIDUAL as LARGEST_RESIDUAL,
)
from .certificate import (
    Certificate as Certificate,
)
from .certificate import (
    certify as certify,
)
from .newton import newton_step as newton_step
from .reference_solvers import time_solvers as time_solvers
