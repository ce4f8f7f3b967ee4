"""The projection of moves on what rails allow, for metrics that couple neurons."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
