"""Steps until settled: update orders, step rules and acceleration, in generated code or in torch.

What a run is told are plain data (`rules`). A run steps in generated code, without torch, or in
`layers` on it, which know acceleration, gradients and GPUs; one step of theirs is in `cell`.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
