from .circuit_samples import CircuitSample as CircuitSample, EmulatedSample as EmulatedSample
from .definitions import theta_over_time as theta_over_time
from .exponents import Exponent as Exponent, exponent_of as exponent_of
from .metrics import (
    DEFAULT as DEFAULT,
    METRICS as METRICS,
    Metric as Metric,
    metrics_of as metrics_of,
)
from .network_samples import BatchSample as BatchSample, RunSample as RunSample
from .sample import Sample as Sample
from .yields import (
    Yield as Yield,
    draws_of as draws_of,
    good_rows as good_rows,
    yield_of as yield_of,
)
