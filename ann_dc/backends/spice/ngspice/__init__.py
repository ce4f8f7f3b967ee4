"""ngspice: a deck goes in, a table comes out, or a reason; this room knows no network."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
