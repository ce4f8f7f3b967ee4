"""Gain design: constant rho, time constants and preconditioner of a wired network."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
