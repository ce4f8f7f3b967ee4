"""How drives become moves: the metric M of dx/ds = M d(x), a record with kinds."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
