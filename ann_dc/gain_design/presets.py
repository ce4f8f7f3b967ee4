"""Presets: starts from which a network settles at a known optimum when it does not from its own.

Only the primal neurons are preset, with the path of the optimum or with a few stages of it; all
multipliers start at zero, but in the last resort, a state near the optimum itself.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from ann_dc.evaluation.reference import evaluator
from ann_dc.evaluation.rules import RoleRows
from ann_dc.network.network import Network

KNOTS = 6
"""Stages of the found path that a coarse preset keeps."""
NEARBY = 0.05
"""Share of the way from an optimum to the network's own start at which the nearest preset lies."""


class Preset(NamedTuple):
    """A start of a network.

    Attributes
    ----------
    words : str
        What it is, for a sentence that says from where a network settles.
    state : (n,) array
    """

    words: str
    state: np.ndarray


def presets_of(network: Network, state: np.ndarray) -> Iterator[Preset]:
    """Yield starts that are nearer and nearer to an optimum.

    Parameters
    ----------
    network : Network
        With its own start.
    state : (n,) array
        The optimum.

    Yields
    ------
    Preset

    Examples
    --------
    >>> from ann_dc import design, plants
    >>> designed = design(plants.double_integrator(N=13))
    >>> for preset in presets_of(designed.network, designed.state):
    ...     print(preset.words)
    6 stages of the found path
    the found path
    a state near the optimum
    """
    primal = np.zeros(len(network.live), bool)
    primal[RoleRows.of(evaluator(network).tape.roles).primal] = True
    path = np.where(primal[:, None], network.unpack(state), 0.0)
    if network.stages > 2 * KNOTS:
        yield Preset(f"{KNOTS} stages of the found path", network.pack(_coarse(path)))
    yield Preset("the found path", network.pack(path))
    near = state + NEARBY * (network.start_state - state)
    yield Preset("a state near the optimum", near)


def _coarse(path: np.ndarray) -> np.ndarray:
    """Return a path (P, N) between some of its stages as straight lines."""
    stages = np.arange(path.shape[1])
    knots = np.rint(np.linspace(0, path.shape[1] - 1, KNOTS)).astype(int)
    return np.array([np.interp(stages, knots, row[knots]) for row in path])
