"""How continuous time is stepped: an explicit pair in compiled code, SciPy's solvers beside it."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
