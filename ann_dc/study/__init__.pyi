from .measuring import Metric as Metric, Yield as Yield
from .study import Study as Study
from .study_file import load_study as load_study
from .table import Table as Table
