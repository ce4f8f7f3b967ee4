from . import library as library
from .exponents import Exponent as Exponent, exponent_of as exponent_of
from .metrics import Metric as Metric
from .records import Row as Row
from .study import Study as Study
from .study_file import load_study as load_study
from .table import Table as Table, load_table as load_table
from .yield_metrics import Yield as Yield
