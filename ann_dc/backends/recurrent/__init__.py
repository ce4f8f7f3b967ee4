"""Recurrent runs until settled: in generated code, or in the torch modules of `layers`."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
