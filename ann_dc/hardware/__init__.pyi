from . import circuit as circuit
from . import emulation as emulation
from . import parts as parts
