"""Interface to ngspice, independent of networks: a deck returns a table or an error."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
