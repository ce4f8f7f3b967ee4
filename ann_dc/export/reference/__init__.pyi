from .places import Places as Places
from .rounding import compare as compare
from .vector import (
    EulerWalk as EulerWalk,
    ReferenceVector as ReferenceVector,
    reference_vector as reference_vector,
)
