from . import plants as plants
from .declaration import OptimalControlProblem as OptimalControlProblem
from .expression import FUNCTIONS as FUNCTIONS
from .expression import parse_expression as parse_expression
from .start import (
    Start as Start,
)
from .start import (
    line_start as line_start,
)
from .start import (
    random_start as random_start,
)
from .start import (
    zero_start as zero_start,
)
from .toml_file import load_problem as load_problem
