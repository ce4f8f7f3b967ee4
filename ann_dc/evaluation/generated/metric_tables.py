"""The numbers that the code of a metric reads: hats and gains, or the factors of a stiffness."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

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
    def neurons(self) -> np.ndarray:
        """(m,): which it couples, at any stage."""
        return np.unique(self.tape.coupled[:-1, 0])

    @cached_property
    def factor(self) -> tuple[np.ndarray, np.ndarray]:
        """Of K, K K' = M^{-1}: within a cell and from the last cell, (N, m, m) each.

        With the identity where there is no neuron.
        """
        tape, size = self.tape, len(self.neurons)
        starts, stages = tape.coupled[:, 2], tape.rates.shape[1]
        values, ends = tape.factor.copy(), starts[1:] - 1
        values[ends] = 1 / values[ends]
        row, column = np.repeat(np.arange(len(ends)), np.diff(starts)), tape.factor_columns
        number, stage = np.searchsorted(self.neurons, tape.coupled[:-1, 0]), tape.coupled[:-1, 1]
        own, last = np.zeros((2, stages, size, size))
        own[:, np.arange(size), np.arange(size)] = 1.0
        for table, apart in ((own, 0), (last, 1)):
            chosen = stage[row] - stage[column] == apart
            i, j = row[chosen], column[chosen]
            table[stage[i], number[i], number[j]] = values[chosen]
        return own, last

    @cached_property
    def halves(self) -> tuple[np.ndarray, ...]:
        """The blocks of a cell, as places in `neurons`: what is tied to the last cell, and to the
        next one.

        One block where some are tied to both.
        """
        own, last = (table != 0 for table in self.factor)
        onward = own[:-1].astype(float) @ last[1:].transpose(0, 2, 1)
        ahead, behind = onward.any(axis=(0, 2)), onward.any(axis=(0, 1))
        if not ahead.any() or (ahead & behind).any():
            return (np.arange(len(ahead)),)
        return np.flatnonzero(~ahead), np.flatnonzero(ahead)

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
        places = np.full((count, size, 2), -1)
        own, following = np.zeros((2, count, size, size))
        own[:, np.arange(size), np.arange(size)] = 1.0
        K, last = self.factor
        cells = K @ K.transpose(0, 2, 1) + last @ last.transpose(0, 2, 1)
        onward = K[:-1] @ last[1:].transpose(0, 2, 1)
        alive = np.zeros((stages, len(self.tape.rates)), bool)
        alive[self.tape.coupled[:-1, 1], self.tape.coupled[:-1, 0]] = True
        for kind, half in enumerate(self.halves):
            other = self.halves[(kind + 1) % kinds]
            inside, beyond = np.ix_(half, half), np.ix_(half, other)
            at = np.arange(stages) * kinds + kind
            own[at, : len(half), : len(half)] = cells[(slice(None), *inside)]
            is_last = kind == kinds - 1  # of its cell
            to = (onward if is_last else cells)[(slice(None), *beyond)]
            following[at[: len(to)], : len(half), : len(other)] = to
            neuron = np.broadcast_to(self.neurons[half], (stages, len(half)))
            stage = np.broadcast_to(np.arange(stages)[:, None], neuron.shape)
            there = np.stack([neuron, stage], axis=-1)
            is_there = alive[:, self.neurons[half], None]
            places[at, : len(half)] = np.where(is_there, there, -1)
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
