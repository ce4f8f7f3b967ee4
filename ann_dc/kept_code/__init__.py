"""Compiled code that is kept on disk: what Numba compiles, and what is generated here."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
