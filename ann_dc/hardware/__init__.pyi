from . import (
    circuit as circuit,
    defects as defects,
    emulation as emulation,
    parts as parts,
    sizing as sizing,
)
