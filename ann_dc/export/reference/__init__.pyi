from .places import Places as Places
from .rounding import rounding_tolerance as rounding_tolerance
from .vector import (
    EulerWalk as EulerWalk,
    ReferenceVector as ReferenceVector,
    reference_vector as reference_vector,
)
