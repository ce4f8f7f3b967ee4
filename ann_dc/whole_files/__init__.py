"""Files are written whole or not at all, by one writer at a time, and read whole or refused."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
