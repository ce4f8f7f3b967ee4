from .by_stages import (
    Minimum as Minimum,
    minimum_by_stages as minimum_by_stages,
    minimum_of as minimum_of,
)
from .curvature import smallest_curvature as smallest_curvature
