from .backend import SpiceBackend as SpiceBackend
from .backend import simulate as simulate
from .circuit_run import OVERLOAD as OVERLOAD
from .circuit_run import CircuitRun as CircuitRun
from .circuit_run import read_back as read_back
from .noise import STEPS as STEPS
from .noise import current_card as current_card
from .noise import with_noise as with_noise
