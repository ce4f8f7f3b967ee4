"""How the points of a study get done: by processes or a cluster, each within its time."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
