"""Words become objects: what a user types, looked up in a table or read as numbers.

Nothing that is typed is ever evaluated. The library is imported inside the functions, so that
``ann-dc --help`` answers at once; what they return is therefore inferred, and not written down.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
