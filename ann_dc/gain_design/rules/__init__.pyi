from .coarse_gains import pyramid as pyramid
from .diode_weights import (
    diode_weights as diode_weights,
    pressed_weights as pressed_weights,
)
from .gains import (
    Gains as Gains,
    apply_gains as apply_gains,
    hand_gains as hand_gains,
    tape_with as tape_with,
)
from .grid_gains import (
    SettledPoint as SettledPoint,
    grid_gains_of as grid_gains_of,
    stiffness_of as stiffness_of,
)
from .presets import COARSE as COARSE, KNOTS as KNOTS, NEARBY as NEARBY, presets_of as presets_of
from .recipe import (
    WITH_COORDINATORS as WITH_COORDINATORS,
    WITHOUT_COORDINATORS as WITHOUT_COORDINATORS,
    Recipe as Recipe,
    base_penalty as base_penalty,
    closed_form as closed_form,
    weights_of_rows as weights_of_rows,
)
from .row_weights import equilibrated as equilibrated
