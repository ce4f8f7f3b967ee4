from .capacitors import released as released
from .idle_clamps import beside_rails as beside_rails, rest_idle as rest_idle
from .op_amps import (
    add_grid_node as add_grid_node,
    add_inverter as add_inverter,
    add_op_amp as add_op_amp,
)
from .transconductors import add_transconductors as add_transconductors
