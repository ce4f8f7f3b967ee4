from .finding import Search as Search, path_of as path_of
from .knowledge import knowledge_of as knowledge_of
from .loading import load_solution as load_solution
from .running import found_without as found_without
from .solution import (
    Solution as Solution,
    certificate_of as certificate_of,
    units_of as units_of,
)
