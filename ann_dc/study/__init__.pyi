from .measuring import METRICS as METRICS, Metric as Metric, Yield as Yield
from .sampling import Sampling as Sampling, Span as Span
from .study import Study as Study
from .study_file import load_study as load_study, study_from as study_from
from .table import Table as Table
from .varying import FAMILIES as FAMILIES
