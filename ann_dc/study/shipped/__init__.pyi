from .hardware import (
    BOARD as BOARD,
    FIGURES as FIGURES,
    SPEC as SPEC,
    spot_check as spot_check,
    yield_curves as yield_curves,
)
