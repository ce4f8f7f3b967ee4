from .bill import COLUMNS as COLUMNS, bill_of as bill_of
from .circuit import (
    CLAMP_REFERENCE as CLAMP_REFERENCE,
    CLAMP_RESTING as CLAMP_RESTING,
    CLAMP_SATURATION as CLAMP_SATURATION,
    Circuit as Circuit,
    circuit_of as circuit_of,
)
from .cost import (
    CAPACITOR as CAPACITOR,
    GENERATOR as GENERATOR,
    GENERATOR_MULTIPLIERS as GENERATOR_MULTIPLIERS,
    MULTIPLIER as MULTIPLIER,
    NEGATIVE as NEGATIVE,
    OP_AMP as OP_AMP,
    OTA as OTA,
    PARTS as PARTS,
    RESISTOR as RESISTOR,
    SWITCH as SWITCH,
    Cost as Cost,
    cost_of as cost_of,
    parts_of as parts_of,
)
from .deviations import (
    Deviations as Deviations,
    checked_deviations as checked_deviations,
    combined as combined,
    draw as draw,
    snapped as snapped,
)
from .generators import built_range as built_range, slopes_of as slopes_of
from .grid_values import (
    GridValues as GridValues,
    begins as begins,
    to_ground as to_ground,
    values_of_grid as values_of_grid,
)
from .loads import (
    Load as Load,
    drawn_of as drawn_of,
    heaviest as heaviest,
    load_power as load_power,
    loads_of as loads_of,
    moving_load as moving_load,
)
from .outputs import Outputs as Outputs
from .parameters import (
    CLAMP_OFFSETS as CLAMP_OFFSETS,
    RESERVED as RESERVED,
    Parameter as Parameter,
    Quantity as Quantity,
    aliases as aliases,
)
from .scaling import (
    MARGIN as MARGIN,
    ProbeRun as ProbeRun,
    Scaling as Scaling,
    ScalingRules as ScalingRules,
    scale as scale,
)
