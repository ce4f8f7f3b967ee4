from .feasibility import feasible_path as feasible_path
from .infeasible import out_of_reach as out_of_reach
