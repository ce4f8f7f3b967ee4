from . import plants as plants
from .declaration import OptimalControlProblem as OptimalControlProblem
from .initial_guess import (
    Start as Start,
    line_start as line_start,
    random_start as random_start,
    zero_start as zero_start,
)
from .robot import car_robot as car_robot, unicycle_robot as unicycle_robot
from .robot_planning import NONLINEAR as NONLINEAR, planning_problem as planning_problem
from .scales import Scales as Scales, scales_of as scales_of, straight_line as straight_line
from .serialisation import declared as declared
from .soft import Soft as Soft
from .step_length import StepLength as StepLength
from .toml_file import load_problem as load_problem
