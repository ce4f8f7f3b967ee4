"""Properties of parts: datasheets, technologies, model levels and part sets.

They do not depend on the network that the parts realise.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
