"""A network's step as arithmetic on numbered words: in real numbers, and in integers."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
