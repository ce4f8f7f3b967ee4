from .certificate import Certificate as Certificate, certify as certify
from .feasibility import feasible_path as feasible_path, out_of_reach as out_of_reach
from .minimum import minimum_of as minimum_of, smallest_curvature as smallest_curvature
from .reference_solvers import (
    SolverIterates as SolverIterates,
    ipopt_point as ipopt_point,
    solver_iterates as solver_iterates,
    time_solvers as time_solvers,
)
