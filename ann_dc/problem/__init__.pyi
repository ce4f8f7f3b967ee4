from . import plants as plants
from .constraints import Inequality as Inequality, Soft as Soft
from .declaration import OptimalControlProblem as OptimalControlProblem
from .excursions import bridge_variance as bridge_variance
from .expression import FUNCTIONS as FUNCTIONS, parse_expression as parse_expression
from .free_time import StepLength as StepLength
from .scales import (
    Scales as Scales,
    natural_scales as natural_scales,
    scales_of as scales_of,
    straight_line as straight_line,
)
from .start import (
    Start as Start,
    line_start as line_start,
    random_start as random_start,
    zero_start as zero_start,
)
from .toml_file import load_problem as load_problem
