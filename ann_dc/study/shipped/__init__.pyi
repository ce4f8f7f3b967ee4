from .basin import SPREADS as SPREADS, End as End, basin as basin, ends as ends
from .constraints import tightened as tightened
from .hardware import (
    BOARD as BOARD,
    FIGURES as FIGURES,
    SPEC as SPEC,
    spot_check as spot_check,
    yield_curves as yield_curves,
)
from .realisations import REALISATIONS as REALISATIONS, realisations as realisations
