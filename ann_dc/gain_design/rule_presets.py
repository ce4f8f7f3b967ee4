"""Presets: starts from which a network settles at a known optimum when it does not from its own.

Only the primal neurons are preset, with the path of the optimum or with a few stages of it; all
multipliers start at zero, but in the last resort, a state near the optimum itself.

References
----------
.. [1] D. H. Douglas, T. K. Peucker, Algorithms for the reduction of the number of points required
   to represent a digitized line or its caricature, Cartographica 10 (1973).
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from ann_dc.analysis.linearisation import Linearisation
from ann_dc.evaluation.reference import evaluator
from ann_dc.evaluation.rules import RoleRows
from ann_dc.gain_design.grid_gains import SettledPoint
from ann_dc.network.network import Network

KNOTS = 6, 12, 24, 48, 96
"""Stages of the found path that coarse presets keep."""
LEAST = 12, 24, 48, 240, 480
"""Stages that a row exceeds to be tried from each of them: long rows are stiffer, and need more."""
COARSE = tuple(f"{knots} stages of the found path" for knots in KNOTS)
"""Words of the coarse presets."""
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
    for knots, least, words in zip(KNOTS, LEAST, COARSE):
        if network.stages > least:
            yield Preset(words, network.pack(_coarse(path, knots)))
    yield Preset("the found path", network.pack(path))
    near = state + NEARBY * (network.start_state - state)
    yield Preset("a state near the optimum", near)


def places_of(settled: SettledPoint) -> Iterator[tuple[str, SettledPoint]]:
    """Yield a settled point with its network at each preset, after the words of the preset.

    Parameters
    ----------
    settled : SettledPoint
    """
    for words, state in presets_of(settled.network, settled.state):
        linear = Linearisation(settled.network.with_start(state)).at(settled.state)
        yield words, SettledPoint(linear, settled.state)


def _coarse(path: np.ndarray, count: int) -> np.ndarray:
    """Return a path (P, N) between a number of its stages as straight lines.

    Each next stage is the one that the lines between the others miss by most, as in [1]_.
    """
    stages, knots = np.arange(path.shape[1]), [0, path.shape[1] - 1]
    span = np.ptp(path, axis=1, keepdims=True)
    for _ in range(count - 2):
        missed = np.abs(path - _between(stages, knots, path)) / np.where(span > 0, span, 1.0)
        knots = sorted({*knots, int(missed.max(axis=0).argmax())})
    return _between(stages, knots, path)


def _between(stages: np.ndarray, knots: list[int], path: np.ndarray) -> np.ndarray:
    return np.array([np.interp(stages, knots, row[knots]) for row in path])
