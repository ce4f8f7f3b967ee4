from .by_stages import Minimum as Minimum
from .curvature import smallest_curvature as smallest_curvature
from .minimum import minimum_by_stages as minimum_by_stages, minimum_of as minimum_of
