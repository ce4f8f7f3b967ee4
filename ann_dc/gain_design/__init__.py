"""Which gains: rho, time constants and metric of a wired network, frozen as constants."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
