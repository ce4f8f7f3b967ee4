"""How equations become a cell: signals, shared products, wires, and units of controls."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
