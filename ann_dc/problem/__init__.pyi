from . import plants as plants
from .declaration import OptimalControlProblem as OptimalControlProblem
from .expression import FUNCTIONS as FUNCTIONS, parse_expression as parse_expression
from .start import (
    Start as Start,
    line_start as line_start,
    random_start as random_start,
    zero_start as zero_start,
)
from .toml_file import load_problem as load_problem
