from .bounds import (
    Bounds as Bounds,
    bounds_of as bounds_of,
    limits_of as limits_of,
    rows_of as rows_of,
)
from .inequality import (
    Inequality as Inequality,
    inequalities_of as inequalities_of,
    relations_of as relations_of,
)
