"""Transistors of a foundry: models of an open PDK, reduced to those in use."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
