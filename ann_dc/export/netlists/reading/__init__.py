"""Netlists of others read with distrust: decks opened to their elements, s-expressions."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
