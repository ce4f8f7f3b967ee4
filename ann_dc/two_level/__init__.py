"""The paper's own algorithm and theory: stages below, a coordinator above.

`layer` runs it, `theorem` measures the rate of its Theorem IV.1 and checks the hypothesis of IV.2,
`upper_gains` chooses and predicts, `lyapunov` and `oracle_gain` are its proof and
the gain that comes from it, `coordination` puts all this together for one problem.

Torch is taken from `ann_dc.backends.recurrent`, which says how to get it where it is
missing.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
