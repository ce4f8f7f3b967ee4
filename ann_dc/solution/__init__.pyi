from .finding import Search as Search, path_of as path_of
from .knowledge import knowledge_of as knowledge_of
from .loading import load_solution as load_solution
from .result_reader import Reader as Reader
from .result_writer import Writer as Writer
from .running import found_without as found_without
from .saved_result import opened_result as opened_result, save_result as save_result
from .solution import (
    Solution as Solution,
    certificate_of as certificate_of,
    units_of as units_of,
)
