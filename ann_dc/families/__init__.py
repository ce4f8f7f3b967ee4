"""One network for many inputs, many starts for one problem: families of runs, judged together."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
