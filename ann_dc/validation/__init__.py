"""Type hints that are kept: arguments are checked against them where a function is called."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
