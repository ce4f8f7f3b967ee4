"""When the end comes is free: the step length as a decision, what it adds, and two plants."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
