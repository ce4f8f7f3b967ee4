"""Is there anything to be found? Paths that meet the constraints, and costs with a minimum."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
