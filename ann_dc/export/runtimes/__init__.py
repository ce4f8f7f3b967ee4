"""Networks for other people's runtimes: programs of torch, graphs of NIR."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
