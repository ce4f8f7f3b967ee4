"""Two-level algorithm and theory of the paper: stages and a coordinator.

Torch is imported through `ann_dc.backends.recurrent`, whose error message describes the
installation if torch is missing.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
