"""A result as a folder: networks as weight files, records by their fields, nothing executable."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
