"""Which resistors, capacitors and margin suit a network on a level: what a circuit is made with."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
