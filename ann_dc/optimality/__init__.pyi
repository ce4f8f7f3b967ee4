from .certificate import (
    LARGEST_RESIDUAL as LARGEST_RESIDUAL,
    Certificate as Certificate,
    certify as certify,
)
from .complementarity import LARGEST_MISS as LARGEST_MISS, Complementarity as Complementarity
from .contact import Contact as Contact
from .expansion import Expansion as Expansion
from .largest import Largest as Largest
from .newton import newton_step as newton_step
from .prospects import (
    Hopeless as Hopeless,
    Infeasible as Infeasible,
    Path as Path,
    Prospect as Prospect,
    Unbounded as Unbounded,
    feasible_path as feasible_path,
    out_of_reach as out_of_reach,
    without_minimum as without_minimum,
)
from .reference_solvers import (
    ReferencePoint as ReferencePoint,
    SolverTiming as SolverTiming,
    ipopt_point as ipopt_point,
    time_solvers as time_solvers,
)
from .second_order import (
    Minimum as Minimum,
    minimum_by_stages as minimum_by_stages,
    minimum_of as minimum_of,
    smallest_curvature as smallest_curvature,
)
from .soft_rows import SoftRows as SoftRows, penalty as penalty
