"""Studies of any plant, problem or network that answer the questions people come with."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
