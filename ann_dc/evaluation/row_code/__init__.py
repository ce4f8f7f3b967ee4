"""Vector code over a whole row: what its cells share, and the residuals of all neurons."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
