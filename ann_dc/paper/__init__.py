"""Example of the paper: runs of the corrected and of the printed equations.

`example` has the runs of the whole network, `replans` the two-level iterations of Figure 6, and
`around` the paths driven among obstacles.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
