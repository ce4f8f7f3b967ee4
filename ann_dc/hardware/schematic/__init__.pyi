from .elements import PICell as PICell, plain_sums as plain_sums
from .preconditioner_wiring import preconditioner_parts as preconditioner_parts
from .schematic import schematic_of as schematic_of
