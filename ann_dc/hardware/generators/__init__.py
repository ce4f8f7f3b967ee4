"""Function generators made of parts: fits to a function, and the multipliers that compute one."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
