"""The paper's own example, run by run: what holds, and what its printed equations give.

`example` has the runs of the whole network, `paths` what Figures 4 and 5 draw of them, `replans`
the two-level iterations of Figure 6, and `around` what of their plans is driven among obstacles.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
