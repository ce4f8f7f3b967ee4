"""Questions of a design to the problem behind its network."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, TypeAlias

import numpy as np

from ann_dc.progress import Progress


class Found(NamedTuple):
    """An optimum that a search found.

    Attributes
    ----------
    state : (n,) array
        Equilibrium of the network.
    by : str
        Name of the search.
    """

    state: np.ndarray
    by: str


Doubt: TypeAlias = Callable[[np.ndarray], None]
"""Asked at a state (n,) where a run stalls, overflows, leaves a domain, or settles where no penalty
holds it; raises `Stopped` where there is nothing to be found."""

Cost: TypeAlias = Callable[[np.ndarray], float]
"""Cost of a settled point (n,)."""

Finder: TypeAlias = Callable[[np.ndarray, Progress], Found | None]
"""Asked once, at the state (n,) of a run; returns a certified optimum, None if it finds none."""


class Knowledge(NamedTuple):
    """Answers of a problem; by default nothing is known.

    Attributes
    ----------
    doubt : Doubt
        Asked where a first run stalls.
    cost : Cost
        Of a settled point: a faster network is not taken where it settles to one that costs more.
    finder : Finder
        Asked for an optimum if the first run does not settle soon.
    cheaper : Finder
        Asked for an optimum that costs less than the one at which the first run settled.

    Examples
    --------
    >>> Knowledge().cost(np.zeros(3))
    0.0
    """

    doubt: Doubt = lambda x: None
    cost: Cost = lambda x: 0.0
    finder: Finder = lambda x, progress: None
    cheaper: Finder = lambda x, progress: None


NOTHING = Knowledge()
"""A network without a problem: its runs are on their own, and all settled points are alike."""
