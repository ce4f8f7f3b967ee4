from .elements import PICell as PICell
from .metric_wiring import metric_parts as metric_parts
from .pass_through_sums import plain_sums as plain_sums
from .schematic import schematic_of as schematic_of
