from .backend import SpiceBackend as SpiceBackend
from .circuit_run import CircuitRun as CircuitRun
from .level_words import level_words as level_words
