from .beside import (
    check_rails as check_rails,
    check_sums as check_sums,
    check_vector as check_vector,
    file_of as file_of,
    notes_of as notes_of,
    text_of as text_of,
    vector_of as vector_of,
    with_sums as with_sums,
)
from .places import Places as Places
from .rounding import TOLERANCES as TOLERANCES, Precision as Precision, compare as compare
from .vector import (
    VECTOR as VECTOR,
    EulerWalk as EulerWalk,
    ReferenceVector as ReferenceVector,
    check_states as check_states,
    reference_vector as reference_vector,
)
