from .equilibria import equilibrium as equilibrium
from .linearisation import Linearisation as Linearisation
from .saddle import Saddle as Saddle, saddle_of as saddle_of
from .second_order import penalty_threshold as penalty_threshold
from .sensitivity import weight_sensitivity as weight_sensitivity
from .slowness import (
    SETTLING_TIME as SETTLING_TIME,
    STEPS as STEPS,
    TWO_PHASE_STEPS as TWO_PHASE_STEPS,
    Objective as Objective,
)
from .spectra import Spectrum as Spectrum, spectrum as spectrum, stability_limit as stability_limit
