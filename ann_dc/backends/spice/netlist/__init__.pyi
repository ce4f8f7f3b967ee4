from .cell_text import CellText as CellText
from .cells import cell_of as cell_of
from .curves import (
    CURVE_CELLS as CURVE_CELLS,
    INSIDE as INSIDE,
    Subcircuit as Subcircuit,
    subcircuit_of as subcircuit_of,
)
from .deck import Deck as Deck, deck_of as deck_of
from .nodes import Nodes as Nodes
from .timing import Simulation as Simulation
from .values import Values as Values
