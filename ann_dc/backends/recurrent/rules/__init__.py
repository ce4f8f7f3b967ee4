"""What a recurrent run is told, as plain data: update orders, step rules, acceleration."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
