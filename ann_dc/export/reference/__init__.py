"""What every export carries beside itself, so that whoever takes it can check what it does."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
