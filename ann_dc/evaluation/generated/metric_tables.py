"""The numbers that the code of a metric reads: hats and gains, or the factors of a stiffness."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.linalg

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
class TwoEnds:
    """M^{-1} of a stiffness, factored as L D L' from either end of the row to its middle.

    From the right everything is the mirror image: the cells and the neurons in a cell come in the
    opposite order. So a cell is tied to the next one in the same way on either side, and one code
    serves both.

    Attributes
    ----------
    tape : Tape
        With a stiffness.
    """

    tape: Tape

    @cached_property
    def neurons(self) -> np.ndarray:
        """(m,): which it couples, at any stage; in this order from the left."""
        return np.unique(self.tape.coupled[:-1, 0])

    @cached_property
    def factor(self) -> tuple[np.ndarray, np.ndarray]:
        """Of K, K K' = M^{-1}: within a cell and from the last cell, (2h + 1, m, m) each.

        With the identity where there is no neuron: a row of even length has a cell more.
        """
        tape, size = self.tape, len(self.neurons)
        starts, stages = tape.coupled[:, 2], tape.rates.shape[1]
        values, ends = tape.factor.copy(), starts[1:] - 1
        values[ends] = 1 / values[ends]
        row, column = np.repeat(np.arange(len(ends)), np.diff(starts)), tape.factor_columns
        number, stage = np.searchsorted(self.neurons, tape.coupled[:-1, 0]), tape.coupled[:-1, 1]
        own, last = np.zeros((2, stages | 1, size, size))
        own[:, np.arange(size), np.arange(size)] = 1.0
        for table, apart in ((own, 0), (last, 1)):
            chosen = stage[row] - stage[column] == apart
            i, j = row[chosen], column[chosen]
            table[stage[i], number[i], number[j]] = values[chosen]
        return own, last

    @cached_property
    def ahead(self) -> np.ndarray:
        """(m, m) booleans: where A may have numbers, on either side.

        Those that are tied to the cell before hear of the first there that is tied to them, and
        of all that come later: within a cell every neuron hears of all before it.
        """
        own, last = ((table != 0).any(axis=0) for table in self.factor)
        tied = last @ own.T
        tied |= tied.T[::-1, ::-1]
        return np.outer(tied.any(axis=1), np.logical_or.accumulate(tied.any(axis=0)))

    def sides(self) -> tuple[np.ndarray, np.ndarray]:
        """K from either side, (h + 1, 2, m, m): within a cell, and from the one before."""
        own, last = self.factor
        middle = len(own) // 2
        mirrored = slice(None, None, -1)
        cells = own @ own.transpose(0, 2, 1) + last @ last.transpose(0, 2, 1)
        ahead = last[1:] @ own[:-1].transpose(0, 2, 1)
        other, behind = _factored(
            cells[mirrored, mirrored, mirrored],
            ahead.transpose(0, 2, 1)[mirrored, mirrored, mirrored],
        )
        within = np.stack([own[: middle + 1], other[: middle + 1]], axis=1)
        before = np.stack([last[: middle + 1], behind[: middle + 1]], axis=1)
        brought = behind[middle] @ behind[middle].T
        rest = own[middle] @ own[middle].T - brought[mirrored, mirrored]
        within[middle] = np.linalg.cholesky(np.stack([rest, rest[mirrored, mirrored]]))
        return within, before


def _factored(cells: np.ndarray, ahead: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """K of K K' = blocks (B, m, m) on and (B - 1, m, m) below the diagonal: on it, and below."""
    count, size, _ = cells.shape
    within, beyond = np.tril_indices(size), np.indices((size, size)).reshape(2, -1)
    band = np.zeros((2 * size, count, size))
    for blocks, (i, j), first, last in ((cells, within, 0, count), (ahead, beyond, size, -1)):
        band[first + i - j, :last, j] = blocks[:, i, j].T
    flat = scipy.linalg.cholesky_banded(band.reshape(2 * size, -1), lower=True)
    band, own, before = flat.reshape(band.shape), np.zeros_like(cells), np.zeros_like(cells)
    for blocks, (i, j), first, last in ((own, within, 0, count), (before[1:], beyond, size, -1)):
        blocks[:, i, j] = band[first + i - j, :last, j].T
    return own, before


def stiffness_tables(tape: Tape) -> dict[str, np.ndarray]:
    """Of a tape with a stiffness: what a cell on either side needs, side by side.

    Parameters
    ----------
    tape : Tape

    Returns
    -------
    dict of str to array
        ``factor`` (h + 1, entries, 2) has -L from the cell before, then -L within the cell, entry
        by entry as `TwoEnds.used` has them, then 1 / D.
    """
    ends = TwoEnds(tape=tape)
    within, before = ends.sides()
    lower = np.tri(within.shape[-1], dtype=bool)
    parts = -before[..., ends.ahead], np.linalg.inv(within)[..., lower]
    factor = np.concatenate(parts, axis=-1).transpose(0, 2, 1)
    return {"middle": np.array(len(factor) - 1), "factor": factor}
