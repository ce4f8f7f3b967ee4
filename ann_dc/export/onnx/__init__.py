"""ONNX export for machine-learning runtimes: one step, and the loop to settling."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
