from . import (
    fixed_point as fixed_point,
    reference as reference,
    results as results,
    weights as weights,
)
