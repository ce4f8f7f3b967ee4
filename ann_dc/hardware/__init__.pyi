from . import circuit as circuit, emulation as emulation, parts as parts
