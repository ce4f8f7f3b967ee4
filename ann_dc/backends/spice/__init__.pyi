from .backend import SpiceBackend as SpiceBackend, simulate as simulate
from .circuit_run import OVERLOAD as OVERLOAD, CircuitRun as CircuitRun, read_back as read_back
from .level_words import level_words as level_words
from .noise import STEPS as STEPS, source_card as source_card, with_noise as with_noise
from .probe import Probed as Probed, probed as probed
from .refinement import refined as refined
from .span import Span as Span, span_of as span_of
