"""Is there anything to be found? Whether a problem can be met at all, and its cost has a minimum."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
