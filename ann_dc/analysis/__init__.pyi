from .equilibria import equilibrium as equilibrium
from .linearisation import Linearisation as Linearisation, MeanLinearisation as MeanLinearisation
from .objectives import (
    SETTLING_TIME as SETTLING_TIME,
    STEPS as STEPS,
    TWO_PHASE_STEPS as TWO_PHASE_STEPS,
    Objective as Objective,
)
from .saddle import (
    RowShadow as RowShadow,
    Saddle as Saddle,
    saddle_of as saddle_of,
    shadow_rows as shadow_rows,
)
from .second_order import penalty_threshold as penalty_threshold
from .sensitivity import (
    input_sensitivity as input_sensitivity,
    weight_sensitivity as weight_sensitivity,
)
from .slowness import (
    LIMIT as LIMIT,
    Cause as Cause,
    Mode as Mode,
    Slowness as Slowness,
    slowness_of as slowness_of,
)
from .spectra import (
    Spectrum as Spectrum,
    slowest_modes as slowest_modes,
    spectrum as spectrum,
    stability_limit as stability_limit,
)
