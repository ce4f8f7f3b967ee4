"""Interface to ngspice: a deck is run and returns a table or an error.

The package does not depend on networks.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
