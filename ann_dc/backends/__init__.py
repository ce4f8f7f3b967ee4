"""How a network runs, and what every run gives back: a trajectory, a settling time, a status.

Every backend takes a `Network` and gives back the same `Run`: a trajectory over network time, and
in one sentence how it ended.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
