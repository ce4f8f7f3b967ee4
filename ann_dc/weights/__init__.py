"""A network as one file of named arrays and a manifest, nothing executable."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
