"""Decomposition: stage Lagrangian (8)-(10), stationarity (11)-(15), with errata."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
