"""Deviation of circuits from the ideal network: predictions, drawn parts, noise.

The package contains predictions by emulation, drawn circuit instances, noise runs, error budgets,
circuit studies and the level comparison.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
