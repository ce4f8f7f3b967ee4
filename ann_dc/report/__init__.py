"""What is said of a result: tables for a terminal, and JSON.

The command line prints what these modules return; they know nothing of it.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
