"""The numbers that the code of a metric reads: hats and gains, or the factors of a stiffness."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import sparse

from ann_dc.evaluation.tape import Tape


def node_width(count: int) -> int:
    """Numbers in a vector that holds those of a node: a power of two, 2 at least."""
    return 1 << max(count - 1, 1).bit_length()


def pyramid_tables(tape: Tape, *, is_coupled: bool) -> dict[str, np.ndarray]:
    """Of a tape with chains; a point without a neuron stands on either side of every level.

    Parameters
    ----------
    tape : Tape
    is_coupled : bool
        Whether gains couple chains; else only their diagonals are read.

    Returns
    -------
    dict of str to array
        ``places`` are (neuron, stage) there, -1 where nothing is.
    """
    sizes = np.diff(tape.grid_starts)
    starts = np.concatenate([[0], np.cumsum(sizes + 2)])
    level = np.repeat(np.arange(len(sizes)), sizes)
    point = starts[level] + 1 + np.arange(len(level)) - tape.grid_starts[level]
    chains = len(tape.chains)
    shape = (int(starts[-1]), *(tape.grids.shape[1:] if is_coupled else (chains,)))
    gains = np.zeros(shape)
    gains[point] = tape.grids if is_coupled else np.einsum("aii->ai", tape.grids)
    wide = np.zeros((*shape[:-1], node_width(chains)))
    wide[..., :chains] = gains
    position = np.arange(len(tape.hats))
    neuron = tape.chains[:, position & 1].T
    stage = np.broadcast_to((position >> 1)[:, None], neuron.shape)
    alive = tape.rates[neuron, stage] != 0
    return {
        "places": np.where(alive[..., None], np.stack([neuron, stage], axis=-1), -1),
        "points": np.array(len(position)),
        "hats": tape.hats + 1,
        "shares": tape.shares,
        "levels": np.array(len(sizes)),
        "starts": starts,
        "gains": wide,
        "nodes": np.zeros(int(starts[-1]) + int(sizes[-1]) // 2 + 2),  # nothing is coarser: zeros
    }


@dataclass(frozen=True, kw_only=True, eq=False)
class Partition:
    """A stiffness as blocks along the row, none of which reaches beyond the next.

    Attributes
    ----------
    tape : Tape
        With a stiffness.
    """

    tape: Tape

    @cached_property
    def matrix(self) -> sparse.csr_array:
        """M^{-1} (S, S) over the neurons that it couples, in the order of the tape."""
        tape = self.tape
        starts = tape.coupled[:, 2]
        values = tape.factor.copy()
        ends = starts[1:] - 1
        values[ends] = 1 / values[ends]
        lower = sparse.csr_array((values, tape.factor_columns, starts), shape=(len(ends),) * 2)
        return sparse.csr_array(lower @ lower.T)

    @cached_property
    def halves(self) -> tuple[np.ndarray, ...]:
        """Neurons of the blocks of a cell: those tied to the last cell and the rest to the next.

        One block where some are tied to both.
        """
        entries = self.matrix.tocoo()
        neuron, stage = self.tape.coupled[:-1, 0], self.tape.coupled[:-1, 1]
        onward = stage[entries.coords[1]] > stage[entries.coords[0]]
        ahead = np.unique(neuron[entries.coords[0]][onward])
        behind = np.unique(neuron[entries.coords[1]][onward])
        every = np.unique(neuron)
        if not len(ahead) or len(np.intersect1d(ahead, behind)):
            return (every,)
        return np.setdiff1d(every, ahead), ahead

    @property
    def size(self) -> int:
        """Neurons of a block, at most."""
        return max(len(half) for half in self.halves)

    def blocks(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Places (B, b, 2), M^{-1} of every block (B, b, b), between it and the next (B, b, b).

        B is odd; the last block may be empty, with the identity.
        """
        stages, size, kinds = self.tape.rates.shape[1], self.size, len(self.halves)
        count = kinds * stages + (1 - kinds * stages % 2)
        block_of = np.full((len(self.tape.rates), 2), -1)
        for kind, half in enumerate(self.halves):
            block_of[half, 0], block_of[half, 1] = kind, np.arange(len(half))
        neuron, stage = self.tape.coupled[:-1, 0], self.tape.coupled[:-1, 1]
        block, number = kinds * stage + block_of[neuron, 0], block_of[neuron, 1]
        places = np.full((count, size, 2), -1)
        places[block, number] = self.tape.coupled[:-1, :2]
        own, following = np.zeros((2, count, size, size))
        own[:, np.arange(size), np.arange(size)] = 1.0
        entries = self.matrix.tocoo()
        row, column = entries.coords
        for table, apart in ((own, 0), (following, 1)):
            chosen = block[column] - block[row] == apart
            i, j = row[chosen], column[chosen]
            table[block[i], number[i], number[j]] = entries.data[chosen]
        return places, own, following


def stiffness_tables(tape: Tape) -> dict[str, np.ndarray]:
    """Of a tape with a stiffness: factors from both ends of the row to its middle.

    Parameters
    ----------
    tape : Tape

    Returns
    -------
    dict of str to array
        ``places`` are (neuron, stage) there, -1 where nothing is.
    """
    places, own, following = Partition(tape=tape).blocks()
    middle, size = len(own) // 2, own.shape[1]
    pair = np.stack([np.arange(middle + 1), len(own) - 1 - np.arange(middle + 1)], axis=1)
    towards = np.stack([following[pair[:, 0]], np.swapaxes(following[pair[:, 1] - 1], -1, -2)], 1)
    diagonal = own[pair].copy()
    forward = np.zeros_like(diagonal)
    backward = np.zeros_like(diagonal)
    for t in range(middle):
        hat = np.linalg.solve(diagonal[t], towards[t])  # D_t^{-1} K_{t,t+1}
        backward[t] = -hat
        forward[t + 1] = -np.swapaxes(hat, -1, -2)
        diagonal[t + 1] += np.swapaxes(towards[t], -1, -2) @ -hat
    diagonal[middle] = diagonal[middle].sum(axis=0) - own[middle]
    paired = places[pair]
    paired[middle, 1] = -1  # the middle is one block, on either side
    return {
        "places": paired.reshape(middle + 1, 2 * size, 2),
        "blocks": np.array(middle),
        "forward": _by_halves(forward),
        "backward": _by_halves(backward),
        "inverse": _by_halves(np.linalg.inv(diagonal)),
        "nodes": np.zeros(middle + 1),
    }


def _by_halves(matrices: np.ndarray) -> np.ndarray:
    """Pairs (t, 2, b, b): column i of either side by side, each as wide as a vector."""
    columns = np.moveaxis(matrices, -1, 1)  # (t, i, 2, b)
    wide = np.zeros((*columns.shape[:-1], node_width(columns.shape[-1])))
    wide[..., : columns.shape[-1]] = columns
    return wide
