"""The numbers that the code of a metric reads: hats and gains, or the factors of a stiffness."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ann_dc.evaluation.tape import Tape

FIELDS = (
    "nodes",
    "places",
    "points",
    "hats",
    "shares",
    "levels",
    "starts",
    "gains",
    "middle",
    "factor",
    "roots",
    "pushed",
    "gaps",
    "gap_places",
)
"""What a metric reads and fills, in the order of the table of addresses."""
INTEGERS = ("points", "levels", "middle", "gaps")
"""Those that are numbers themselves."""


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
    """M^{-1} of a stiffness, factored from either end of the row to its middle.

    K is what a cell says to itself, lower triangular, and A what the cell before says to it. From
    the right everything is the mirror image: the cells come in the opposite order, and so do the
    neurons in a cell. A cell is thus tied to the next one in the same way on either side, and one
    code serves both. A row of even length has a cell more, without neurons: the identity.

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
        """K and A of every cell, from the left to the right end, (2h + 1, m, m) each."""
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
        """K and A from either side, (h + 1, 2, m, m) each.

        From the left as the tape has them. From the right K is turned, cell by cell, so that M^{-1}
        stays the same to rounding: what a cell says to the one on its left it then no longer says.
        """
        (own, last), size = self.factor, len(self.neurons)
        middle = len(own) // 2
        within, before = np.stack([own, own], axis=1), np.stack([last, np.zeros_like(last)], axis=1)
        mirrored, rest = np.flip(own), np.flip(own[-1])
        for t, to in enumerate(np.flip(last)[:middle]):
            turn, factor = np.linalg.qr(np.hstack([rest, to]).T, mode="complete")
            turned = mirrored[t + 1] @ turn[size:]
            within[t, 1], before[t + 1, 1] = factor[:size].T, turned[:, :size]
            rest = turned[:, size:]
        both = np.stack([np.flip(rest), rest]).transpose(0, 2, 1)
        _, factors = np.linalg.qr(both)
        within[middle] = factors.transpose(0, 2, 1)
        return within[: middle + 1], before[: middle + 1]


def stiffness_tables(tape: Tape) -> dict[str, np.ndarray]:
    """Of a tape with a stiffness: what a cell on either side needs, side by side.

    Parameters
    ----------
    tape : Tape

    Returns
    -------
    dict of str to array
        ``places`` (h + 1, 2) are (neuron, stage) where the cells begin, -1 for the one that is not
        there, and ``gap_places`` those of neurons that are not; ``factor`` (h + 1, entries, 2) has
        -A, then K^{-1} row by row; ``middle`` is h.
    """
    ends = TwoEnds(tape=tape)
    within, before = ends.sides()
    lower = np.tri(within.shape[-1], dtype=bool)
    parts = -before[..., ends.ahead], np.linalg.inv(within)[..., lower]
    factor = np.concatenate(parts, axis=-1).transpose(0, 2, 1)
    middle = len(factor) - 1
    stage = np.stack([np.arange(middle + 1), np.arange(2 * middle, middle - 1, -1)], axis=1)
    neuron = np.where(stage < tape.rates.shape[1], 0, -1)
    number, gap = np.nonzero(tape.rates[ends.neurons] == 0)
    return {
        "places": np.stack([neuron, stage], axis=-1),
        "middle": np.array(middle),
        "factor": factor,
        "gaps": np.array(len(gap)),
        "gap_places": np.stack([ends.neurons[number], gap], axis=-1),
    }
