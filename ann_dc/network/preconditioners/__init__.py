"""Preconditioners of the network flow: the matrix M of dx/ds = M d(x), by kind."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
