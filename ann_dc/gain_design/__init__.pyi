from .gains import Gains as Gains, apply_gains as apply_gains, hand_gains as hand_gains
from .grid_gains import SettledPoint as SettledPoint, stiffness_of as stiffness_of
from .procedure import Design as Design, design as design
from .recipe import (
    WITH_COORDINATORS as WITH_COORDINATORS,
    WITHOUT_COORDINATORS as WITHOUT_COORDINATORS,
    Recipe as Recipe,
    closed_form as closed_form,
)
