from . import (
    circuit as circuit,
    emulation as emulation,
    nonidealities as nonidealities,
    parts as parts,
    sizing as sizing,
)
