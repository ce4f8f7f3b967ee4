"""Networks as circuits in ngspice: netlist, simulation and read-back by neuron."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
