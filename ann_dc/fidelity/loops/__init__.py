"""The loops around the op amps of a circuit: how far each is from ringing."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
