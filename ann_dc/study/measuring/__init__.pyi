from .exponents import Exponent as Exponent, exponent_of as exponent_of
from .metrics import Metric as Metric
from .yields import Yield as Yield
