from .base import (
    ArrayLayout as ArrayLayout,
    PreconditionerKind as PreconditionerKind,
    Wires as Wires,
)
from .cyclic_reduction import CyclicReduction as CyclicReduction
from .diagonal import Diagonal as Diagonal
from .resistive_grid import ResistiveGrid as ResistiveGrid
