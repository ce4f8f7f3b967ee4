"""Networks in torch: one step of a cell, and recurrent layers that run, train and differentiate."""

import lazy_loader

try:
    import torch as torch
except ImportError as error:
    raise ImportError(
        "recurrent layers need torch, which is not installed: pip install 'ann-dc[torch]'"
    ) from error

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
