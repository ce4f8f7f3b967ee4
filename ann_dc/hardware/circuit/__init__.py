"""Circuit of one network: parts, wires, volts and ohms; every number has a name."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
