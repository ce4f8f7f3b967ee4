from .corners import corners as corners
from .effects import (
    Effect as Effect,
    Found as Found,
    effects_table as effects_table,
    known_effects as known_effects,
    with_parasitics as with_parasitics,
)
from .interface import Interface as Interface, interface_cost as interface_cost
from .spec import spec_of as spec_of
from .systematic import systematic as systematic
from .trimming import trimming as trimming
from .yields import yield_of as yield_of
