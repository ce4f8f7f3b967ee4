"""Studies that come with the package: of any plant, problem or network, each with its question."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
