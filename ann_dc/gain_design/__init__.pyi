from .neighbourhood import neighbourhood as neighbourhood
from .procedure import Design as Design
from .rules import (
    WITH_COORDINATORS as WITH_COORDINATORS,
    WITHOUT_COORDINATORS as WITHOUT_COORDINATORS,
    Gains as Gains,
    Recipe as Recipe,
    apply_gains as apply_gains,
    closed_form as closed_form,
    hand_gains as hand_gains,
)
