"""Figures 4 to 6 of the paper, drawn from plain numbers: paths, discs, iterations.

Path planners can use the same functions, which do not depend on a solver.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
