from .boundedness import Unbounded as Unbounded, without_minimum as without_minimum
from .feasibility import feasible_path as feasible_path
from .infeasible import Infeasible as Infeasible, out_of_reach as out_of_reach
from .prospect import Hopeless as Hopeless, Prospect as Prospect
from .search import Path as Path
