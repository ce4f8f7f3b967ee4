"""Runs over operating ranges, many initial guesses and several objectives.

One network serves many inputs, or many initial guesses of one problem, and the runs are evaluated
together.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
