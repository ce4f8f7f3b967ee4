"""What it is built of: parts, one network as a circuit, and that circuit as a network again."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
