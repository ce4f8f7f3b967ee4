from .backend import SpiceBackend as SpiceBackend, simulate as simulate
from .circuit_run import OVERLOAD as OVERLOAD, CircuitRun as CircuitRun, read_back as read_back
from .level_words import level_words as level_words
from .noise import STEPS as STEPS, source_card as source_card, with_noise as with_noise
