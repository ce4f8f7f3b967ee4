"""Example of the paper: runs of the corrected and of the printed equations.

`example` contains the runs of the whole network and `paths` the data of Figures 4 and 5. `replans`
contains the two-level iterations of Figure 6, and `around` the paths driven among obstacles.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
