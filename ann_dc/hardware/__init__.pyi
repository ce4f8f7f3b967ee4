from . import (
    circuit as circuit,
    defects as defects,
    emulation as emulation,
    generators as generators,
    parts as parts,
    sizing as sizing,
)
