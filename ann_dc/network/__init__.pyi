from .cell import (
    ONE as ONE,
    Cell as Cell,
    Connection as Connection,
    Function as Function,
    Limiter as Limiter,
    Neuron as Neuron,
    Product as Product,
    Sum as Sum,
    Template as Template,
)
from .duals import InequalityDual as InequalityDual
from .extrema import maximum as maximum, minimum as minimum
from .network import Network as Network
from .waveforms import Waveform as Waveform
