"""What a network computes: one contract, one evaluator an array library, one tape for all."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
