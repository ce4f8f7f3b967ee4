"""Integration in continuous time: a compiled explicit pair and SciPy's solvers."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
