from .report import report as report
from .study import study as study
