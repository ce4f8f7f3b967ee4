"""What parts on a board do to a circuit that ideal ones do not: predicted and simulated."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
