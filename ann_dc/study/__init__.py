"""Studies: how long it takes to settle, and what that depends on; declared, run, resumed."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
