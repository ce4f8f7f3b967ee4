"""Code generated for a wiring; a lane of every vector is a stage or a sample."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
