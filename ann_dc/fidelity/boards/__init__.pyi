from .effects import (
    Effect as Effect,
    Found as Found,
    effects_table as effects_table,
    known_effects as known_effects,
    with_parasitics as with_parasitics,
)
from .systematic import systematic as systematic
