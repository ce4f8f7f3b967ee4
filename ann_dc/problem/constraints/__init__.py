"""What is to hold along the way: inequalities, and bounds of states and controls."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
