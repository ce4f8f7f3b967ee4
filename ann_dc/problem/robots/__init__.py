"""Robots that drive in a plane, and the problem that one of them solves every period."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
