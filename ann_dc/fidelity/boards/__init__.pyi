from .corners import corners as corners
from .effects import (
    Effect as Effect,
    Found as Found,
    effects_table as effects_table,
    known_effects as known_effects,
    systematic as systematic,
    with_parasitics as with_parasitics,
)
from .interface import Interface as Interface, interface_cost as interface_cost
from .trimming import trimming as trimming
from .yields import spec_of as spec_of, yield_of as yield_of
