"""Presets: initial guesses near a known optimum that a network does not reach.

Only the primal neurons are preset, with the path of the optimum or a few stages of the path. All
multipliers start at zero, except in the last preset, a state near the optimum.

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
"""Numbers of stages of the found path in coarse presets."""
LEAST = 12, 24, 48, 240, 480
"""Horizons above which each coarse preset is tried; longer arrays are stiffer."""
COARSE = tuple(f"{knots} stages of the known trajectory" for knots in KNOTS)
"""Descriptions of the coarse presets."""
NEARBY = 0.05
"""Distance of the nearest preset from the optimum, relative to the network's initial guess."""


class Preset(NamedTuple):
    """Initial guess `state` (n,) of a network, and its description for messages."""

    words: str
    state: np.ndarray


def presets_of(network: Network, state: np.ndarray) -> Iterator[Preset]:
    """Yield initial guesses that approach an optimum, coarse ones first.

    `network` has its default initial guess; `state` (n,) is the optimum.
    """
    primal = np.zeros(len(network.live), bool)
    primal[RoleRows.of(evaluator(network).tape.roles).primal] = True
    path = np.where(primal[:, None], network.unpack(state), 0.0)
    for knots, least, words in zip(KNOTS, LEAST, COARSE):
        if network.stages > least:
            yield Preset(words, network.pack(_coarse(path, knots)))
    yield Preset("the known trajectory", network.pack(path))
    near = state + NEARBY * (network.start_state - state)
    yield Preset("a state near the optimum", near)


def places_of(settled: SettledPoint) -> Iterator[tuple[str, SettledPoint]]:
    """Yield the description of each preset and a settled point of its network."""
    for words, state in presets_of(settled.network, settled.state):
        linear = Linearisation(settled.network.with_start(state)).at(settled.state)
        yield words, SettledPoint(linear, settled.state)


def _coarse(path: np.ndarray, count: int) -> np.ndarray:
    """Return a path (P, N) as straight lines between a number of its stages.

    The next stage is the one with the largest interpolation error, as in [1]_.
    """
    stages, knots = np.arange(path.shape[1]), [0, path.shape[1] - 1]
    span = np.ptp(path, axis=1, keepdims=True)
    for _ in range(count - 2):
        missed = np.abs(path - _between(stages, knots, path)) / np.where(span > 0, span, 1.0)
        knots = sorted({*knots, int(missed.max(axis=0).argmax())})
    return _between(stages, knots, path)


def _between(stages: np.ndarray, knots: list[int], path: np.ndarray) -> np.ndarray:
    return np.array([np.interp(stages, knots, row[knots]) for row in path])
