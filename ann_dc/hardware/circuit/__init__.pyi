from .bill import COLUMNS as COLUMNS
from .bill import bill_of as bill_of
from .circuit import Circuit as Circuit
from .circuit import circuit_of as circuit_of
from .cost import (
    CAPACITOR as CAPACITOR,
)
from .cost import (
    GENERATOR as GENERATOR,
)
from .cost import (
    GENERATOR_MULTIPLIERS as GENERATOR_MULTIPLIERS,
)
from .cost import (
    MULTIPLIER as MULTIPLIER,
)
from .cost import (
    OP_AMP as OP_AMP,
)
from .cost import (
    OTA as OTA,
)
from .cost import (
    PARTS as PARTS,
)
from .cost import (
    RESISTOR as RESISTOR,
)
from .cost import (
    SWITCH as SWITCH,
)
from .cost import (
    Cost as Cost,
)
from .cost import (
    cost_of as cost_of,
)
from .cost import (
    parts_of as parts_of,
)
from .coupling import coupling_of as coupling_of
from .coupling import own_integrals as own_integrals
from .deviations import (
    Deviations as Deviations,
)
from .deviations import (
    checked as checked,
)
from .deviations import (
    combined as combined,
)
from .deviations import (
    draw as draw,
)
from .deviations import (
    snapped as snapped,
)
from .elements import (
    Adder as Adder,
)
from .elements import (
    Amplifier as Amplifier,
)
from .elements import (
    Generator as Generator,
)
from .elements import (
    Integrator as Integrator,
)
from .elements import (
    Multiplier as Multiplier,
)
from .elements import (
    Part as Part,
)
from .elements import (
    PICell as PICell,
)
from .elements import (
    Wire as Wire,
)
from .parameters import (
    RESERVED as RESERVED,
)
from .parameters import (
    Parameter as Parameter,
)
from .parameters import (
    Quantity as Quantity,
)
from .parameters import (
    aliases as aliases,
)
from .scaling import (
    MARGIN as MARGIN,
)
from .scaling import (
    ProbeRun as ProbeRun,
)
from .scaling import (
    Scaling as Scaling,
)
from .scaling import (
    ScalingRules as ScalingRules,
)
from .scaling import (
    scale as scale,
)
from .schematic import schematic_of as schematic_of
