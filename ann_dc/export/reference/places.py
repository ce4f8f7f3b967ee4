"""Positions of state vector components in a test vector's arrays, as numbers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ann_dc.errors import FileFormatError
from ann_dc.network.network import Network


class Places:
    """Pairs (neuron, stage) of every component: one, or all stages of a shared neuron.

    Parameters
    ----------
    pairs : sequence of lists of (int, int)
        One nonempty list per component.

    Examples
    --------
    >>> places = Places([[[0, 1]], [[1, 0], [1, 1]]])
    >>> states = places.unpack(np.array([5.0, 7.0]), np.zeros((2, 2)))
    >>> states.tolist(), places.pack(states).tolist()
    ([[0.0, 5.0], [7.0, 7.0]], [5.0, 7.0])
    """

    def __init__(self, pairs: Sequence[Sequence[Sequence[int]]]) -> None:
        self.pairs = pairs
        self._component = np.repeat(np.arange(len(pairs)), [len(p) for p in pairs])
        self._rows, self._stages = np.array([pair for p in pairs for pair in p]).reshape(-1, 2).T
        self._homes = np.array([p[-1] for p in pairs]).reshape(-1, 2).T

    def __len__(self) -> int:
        return len(self.pairs)

    @classmethod
    def of(cls, network: Network) -> Places:
        """Return the positions for a network."""
        shared, stages = set(network.shared.tolist()), range(network.stages)
        return cls([
            [[row, k] for k in stages] if row in shared else [[row, stage]]
            for row, stage in network.places.tolist()
        ])  # fmt: skip

    @classmethod
    def read(cls, given: Any, shape: tuple[int, ...], where: str) -> Places:
        """Parse positions from a JSON list, for arrays of the given shape.

        Messages begin with ``where``. Raises `FileFormatError` if the positions are invalid.
        """
        if not isinstance(given, list) or not given:
            raise FileFormatError(f"{where}: expected a list of places")
        for pairs in given:
            if not isinstance(pairs, list) or not pairs or not all(_fits(p, shape) for p in pairs):
                raise FileFormatError(f"{where}: expected places in arrays of shape {shape}")
        return cls(given)

    def pack(self, states: np.ndarray) -> np.ndarray:
        """Return state vectors (..., n) from states (..., P, N)."""
        return states[(..., *self._homes)]

    def unpack(self, x: np.ndarray, states: np.ndarray) -> np.ndarray:
        """Return the states (P, N) with the components of a state vector (n,) inserted."""
        states = np.array(states)
        states[self._rows, self._stages] = x[self._component]
        return states


def _fits(pair: Any, shape: tuple[int, ...]) -> bool:
    whole = isinstance(pair, list) and len(pair) == 2 and all(type(k) is int for k in pair)
    return whole and all(0 <= k < size for k, size in zip(pair, shape))
