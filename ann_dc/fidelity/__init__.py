"""How far a circuit is from the ideal: predicted, drawn, in noise, budgeted, studied, climbed."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
