"""Conversion of command-line text to objects, by table lookup or number parsing.

User input is never evaluated as code. The library is imported inside the functions, so ``ann-dc
--help`` starts without delay. Return types are therefore inferred and not annotated.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
