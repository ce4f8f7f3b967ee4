"""Callbacks from a design to the problem behind its network."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, TypeAlias

import numpy as np

from ann_dc.progress import Progress


class Found(NamedTuple):
    """Optimum of the search named `by`: an equilibrium `state` (n,) of the network."""

    state: np.ndarray
    by: str


_Doubt: TypeAlias = Callable[[np.ndarray], None]
"""Check at a state (n,) where a run stalls, overflows, leaves a domain, or settles where no penalty
stabilises it; raises `Stopped` if the problem has no solution.
"""

Cost: TypeAlias = Callable[[np.ndarray], float]
"""Cost of a settled point (n,)."""

Finder: TypeAlias = Callable[[np.ndarray, Progress], Found | None]
"""Search called once, at the state (n,) of a run; returns a certified optimum or None."""


class Knowledge(NamedTuple):
    """Callbacks of a problem; by default nothing is known.

    `doubt` is called when a first run stalls. `cost` is that of a settled point: a faster network
    that settles at a higher cost is rejected. `finder` searches for an optimum if the first run
    does not settle soon, `cheaper` for one of lower cost than the point at which it settled.
    """

    doubt: _Doubt = lambda x: None
    cost: Cost = lambda x: 0.0
    finder: Finder = lambda x, progress: None
    cheaper: Finder = lambda x, progress: None


NOTHING = Knowledge()
"""Callbacks of a network without a problem: no checks, equal costs of all settled points."""
