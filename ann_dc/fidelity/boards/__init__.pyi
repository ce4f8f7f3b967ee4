from .effects import (
    Effect as Effect,
    Found as Found,
    effects as effects,
    effects_table as effects_table,
    with_parasitics as with_parasitics,
)
from .systematic import systematic as systematic
