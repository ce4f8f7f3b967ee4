from .corners import Corner as Corner, corners as corners
from .effects import (
    Effect as Effect,
    Found as Found,
    effects_table as effects_table,
    known_effects as known_effects,
    with_parasitics as with_parasitics,
)
from .interface import (
    Interface as Interface,
    InterfaceCost as InterfaceCost,
    interface_cost as interface_cost,
)
from .readings import Reading as Reading, misread as misread, reading_of as reading_of
from .spec import Spec as Spec, spec_of as spec_of
from .systematic import systematic as systematic
from .trim_order import Step as Step, trim_steps as trim_steps
from .trimming import Trimming as Trimming, trimming as trimming
from .yields import CircuitYield as CircuitYield, Spot as Spot, yield_of as yield_of
