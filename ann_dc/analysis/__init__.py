"""What is known at a state without running: spectrum, equilibrium, sensitivity, second order."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
