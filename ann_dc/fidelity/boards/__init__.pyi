from .corners import Corner as Corner, corners as corners
from .spec import Spec as Spec, spec_of as spec_of
from .yields import CircuitYield as CircuitYield, Spot as Spot, yield_of as yield_of
