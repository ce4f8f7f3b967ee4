"""The page of a study: one HTML file that needs nothing else, to be read, searched and printed."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
