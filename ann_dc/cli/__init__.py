"""Command line `ann-dc`, with the commands `solve`, `design`, `coordinate` etc.

Further commands are for example `circuit` and `show`.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
