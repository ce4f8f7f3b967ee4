from .equilibria import equilibrium as equilibrium
from .linearisation import Linearisation as Linearisation, MeanLinearisation as MeanLinearisation
from .objectives import (
    SETTLING_TIME as SETTLING_TIME,
    STEPS as STEPS,
    TWO_PHASE_STEPS as TWO_PHASE_STEPS,
)
from .predicted_settling import predicted_settling as predicted_settling
from .sensitivity import input_sensitivity as input_sensitivity
from .slowness import slowness_of as slowness_of
from .spectra import Spectrum as Spectrum, spectrum as spectrum, stability_limit as stability_limit
