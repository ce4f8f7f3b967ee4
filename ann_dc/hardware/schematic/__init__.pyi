from .buildable import check_metric as check_metric
from .elements import (
    Adder as Adder,
    Amplifier as Amplifier,
    Generator as Generator,
    GridNode as GridNode,
    Integrator as Integrator,
    Multiplier as Multiplier,
    Part as Part,
    PICell as PICell,
    Wire as Wire,
)
from .metric_parts import metric_parts as metric_parts, metric_values as metric_values
from .metric_wiring import OWN as OWN, MetricWiring as MetricWiring, wiring_of as wiring_of
from .plain_sums import plain_sums as plain_sums
from .rails import check_rails as check_rails, with_rails as with_rails
from .schematic import Schematic as Schematic, schematic_of as schematic_of
from .shared import check_shared as check_shared, shared_nodes as shared_nodes
