from .gain_rule import (
    WITH_COORDINATORS as WITH_COORDINATORS,
    WITHOUT_COORDINATORS as WITHOUT_COORDINATORS,
    Recipe as Recipe,
    closed_form as closed_form,
)
from .gains import Gains as Gains, apply_gains as apply_gains, hand_gains as hand_gains
from .neighbourhood import neighbourhood as neighbourhood
from .procedure import Design as Design
