"""What ``ann-dc circuit`` can be asked of a circuit away from the bench."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
