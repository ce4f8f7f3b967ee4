"""Figures 4 to 6 of the paper, drawn anew from plain numbers: paths, discs, iterations.

Whoever plans a path around obstacles draws it with the same functions: they know no solver.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
