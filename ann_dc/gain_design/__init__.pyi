from .gain_rule import (
    DIAGONAL_RULE as DIAGONAL_RULE,
    MULTILEVEL_RULE as MULTILEVEL_RULE,
    GainRule as GainRule,
    closed_form as closed_form,
)
from .gains import Gains as Gains, apply_gains as apply_gains, manual_gains as manual_gains
from .neighbourhood import neighbourhood as neighbourhood
from .procedure import Design as Design
