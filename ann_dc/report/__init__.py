"""Reports of results: terminal tables and JSON.

The command line prints the objects that these modules return. The modules do not depend on the
command line.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
