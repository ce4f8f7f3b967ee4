"""Several objectives, of which the largest is minimised; and the units in which all is told."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
