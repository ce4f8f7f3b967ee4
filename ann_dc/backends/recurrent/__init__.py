"""Steps until settled, in torch: update orders, step rules, acceleration, layers.

One step of a cell is in `cell`; here are the orders in which its neurons move, the lengths of
steps, acceleration, and the loop that steps until every sample has settled.
"""

import lazy_loader

try:
    import torch as torch
except ImportError as error:
    raise ImportError(
        "the recurrent layers run on torch, which is not installed: pip install 'ann-dc[torch]'"
    ) from error

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
