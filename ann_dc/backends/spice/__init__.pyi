from .backend import SpiceBackend as SpiceBackend
from .circuit_run import CircuitRun as CircuitRun
