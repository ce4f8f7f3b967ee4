from .elements import (
    Adder as Adder,
    Amplifier as Amplifier,
    Generator as Generator,
    Integrator as Integrator,
    Multiplier as Multiplier,
    Part as Part,
    PICell as PICell,
    Wire as Wire,
)
from .metric_parts import OWN as OWN, metric_adders as metric_adders, metric_values as metric_values
from .metric_wiring import MetricWiring as MetricWiring, wiring_of as wiring_of
from .schematic import Schematic as Schematic, schematic_of as schematic_of
