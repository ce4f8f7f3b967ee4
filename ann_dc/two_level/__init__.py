"""Two-level algorithm and theory of the paper: stages and a coordinator.

`layer` runs the algorithm. `theorem` computes the rate of Theorem IV.1 and checks the hypothesis of
Theorem IV.2. `upper_gains` chooses gains and predicts the rate, `lyapunov` and `oracle_gain`
contain the convergence proof and its gain, and `coordination` combines all parts for one problem.

Torch is imported through `ann_dc.backends.recurrent`, whose error message describes the
installation if torch is missing.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
