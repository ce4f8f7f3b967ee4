"""A network read as parts: which op amps and multipliers, wired how, with which signs."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
