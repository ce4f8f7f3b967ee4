"""Networks in fixed point: integers alone, in C and as digital hardware, bit for bit the same."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
