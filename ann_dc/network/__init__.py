"""What is wired: records of a cell, N of them in a row, ends and metric; nothing runs."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
