"""Is it a minimum? The second order on the tangent space of what has to hold, in three ways."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
