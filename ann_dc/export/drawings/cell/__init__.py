"""The cell of a network laid out: boxes in columns, columns in panels, wires between them."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
