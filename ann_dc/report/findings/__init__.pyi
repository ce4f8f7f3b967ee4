from .bands import (
    Band as Band,
    band as band,
    boxes as boxes,
    combinations as combinations,
    groups as groups,
    is_clustered as is_clustered,
    strength as strength,
)
from .causes import causes as causes, slowest as slowest, worst as worst
from .columns import Column as Column
from .exponents import Growth as Growth, exponents as exponents
from .findings import Findings as Findings
from .shares import (
    Limit as Limit,
    limits as limits,
    settled as settled,
    within as within,
    yield_of as yield_of,
)
