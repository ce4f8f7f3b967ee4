"""Recurrent runs until settled, in generated code or in torch.

Update orders, step rules and acceleration are plain data (`rules`). A run uses generated code,
without torch, or the torch modules of `layers`, which support acceleration, gradients and GPUs. One
step of the layers is in `cell`.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
