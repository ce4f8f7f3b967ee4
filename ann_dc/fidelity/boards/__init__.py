"""What a circuit does away from the bench: what parts of a board add, corners, yield, trimming."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
