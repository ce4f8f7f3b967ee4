from .doubt import doubt_of as doubt_of, path_of as path_of
from .loading import load_solution as load_solution
from .solution import (
    Solution as Solution,
    certificate_of as certificate_of,
    units_of as units_of,
)
