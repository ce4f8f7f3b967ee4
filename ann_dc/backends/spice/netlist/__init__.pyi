from .cell_text import CellText as CellText
from .cells import cell_of as cell_of
from .curves import (
    CURVE_CELLS as CURVE_CELLS,
)
from .curves import (
    INSIDE as INSIDE,
)
from .curves import (
    Subcircuit as Subcircuit,
)
from .curves import (
    subcircuit_of as subcircuit_of,
)
from .deck import Deck as Deck
from .deck import deck_of as deck_of
from .nodes import Nodes as Nodes
from .timing import Simulation as Simulation
from .values import Values as Values
