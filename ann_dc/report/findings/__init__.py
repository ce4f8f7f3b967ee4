"""What a study found, in numbers: outcomes by cause, shares within a spec, medians, exponents."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
