"""Amplifiers as neurons: op amps or transconductors, their capacitors, grounds and clamps."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
