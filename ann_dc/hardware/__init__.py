"""Analog hardware: parts, the circuit of a network, and its behavioural emulation."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
