from .levels import LEVELS as LEVELS, level_of as level_of
from .realisation import Built as Built, Designed as Designed, Realisation as Realisation
from .settings import (
    FAMILIES as FAMILIES,
    WORDS as WORDS,
    Effect as Effect,
    Family as Family,
    names_of as names_of,
)
from .subject import Subject as Subject, subject_from as subject_from, subject_of as subject_of
from .variants import (
    BRINGERS as BRINGERS,
    network_at as network_at,
    started as started,
    with_defects as with_defects,
    with_gains as with_gains,
)
