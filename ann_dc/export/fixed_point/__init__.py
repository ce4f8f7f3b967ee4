"""Fixed-point exports: bit-identical integer arithmetic in C and in hardware."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
