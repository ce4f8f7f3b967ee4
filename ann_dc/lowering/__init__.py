"""One lowering of a network to a list of scalar operations, from which texts are printed."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
