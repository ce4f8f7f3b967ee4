from .circuits import (
    BOARD as BOARD,
    FIGURES as FIGURES,
    REALISATIONS as REALISATIONS,
    SPEC as SPEC,
    realisations as realisations,
    spot_check as spot_check,
    yield_curves as yield_curves,
)
from .settling import (
    FACTORS as FACTORS,
    SHARES as SHARES,
    SIZES as SIZES,
    boundaries as boundaries,
    median_rho as median_rho,
    settling_against_gains as settling_against_gains,
    settling_against_horizon as settling_against_horizon,
    settling_against_steps as settling_against_steps,
    tightened as tightened,
)
