from . import (
    devices as devices,
    reference as reference,
    results as results,
    weights as weights,
)
