from .places import Places as Places
from .rounding import TOLERANCES as TOLERANCES, Precision as Precision, compare as compare
from .vector import (
    EulerWalk as EulerWalk,
    ReferenceVector as ReferenceVector,
    reference_vector as reference_vector,
)
