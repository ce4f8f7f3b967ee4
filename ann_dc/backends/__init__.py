"""Backends that run a network and return trajectory, settling time and status.

Every backend takes a `Network` and returns the same record, `Run`: a trajectory over network time
and one sentence on how the run ended.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
