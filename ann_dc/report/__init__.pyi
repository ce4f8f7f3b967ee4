from .circuit import CircuitReport as CircuitReport
