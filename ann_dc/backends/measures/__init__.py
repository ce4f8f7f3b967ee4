"""What is read off the curve of a run: how fast it ends, and how far it goes beyond its end."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
