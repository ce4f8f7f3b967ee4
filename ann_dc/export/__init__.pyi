from . import (
    devices as devices,
    drawings as drawings,
    netlists as netlists,
    reference as reference,
    results as results,
    weights as weights,
)
