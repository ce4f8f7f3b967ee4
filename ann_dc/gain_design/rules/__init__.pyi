from .coarse_gains import diode_weights as diode_weights
from .gains import Gains as Gains, apply_gains as apply_gains, hand_gains as hand_gains
from .recipe import (
    WITH_COORDINATORS as WITH_COORDINATORS,
    WITHOUT_COORDINATORS as WITHOUT_COORDINATORS,
    Recipe as Recipe,
    closed_form as closed_form,
)
