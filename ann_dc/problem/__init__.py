"""What is to be solved: declarations in the user's symbols, plants, problem files, starts."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
