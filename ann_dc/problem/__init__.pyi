from . import plants as plants
from .declaration import OptimalControlProblem as OptimalControlProblem
from .initial_guess import (
    InitialGuess as InitialGuess,
    interpolated_guess as interpolated_guess,
    random_guess as random_guess,
    zero_guess as zero_guess,
)
from .robot import car_robot as car_robot, unicycle_robot as unicycle_robot
from .robot_planning import NONLINEAR as NONLINEAR, planning_problem as planning_problem
from .scales import Scales as Scales, scales_of as scales_of, straight_line as straight_line
from .serialisation import declared as declared
from .soft import Soft as Soft
from .step_length import StepLength as StepLength
from .toml_file import load_problem as load_problem
