"""The commands, a module each: words become objects, the library is called, a report is printed."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
