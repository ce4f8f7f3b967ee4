"""Multilevel preconditioner as sums: down to the coarse grids and back."""

from __future__ import annotations

import numpy as np

from ann_dc.evaluation.tape import Tape
from ann_dc.lowering.program import SUM, ZERO, Listing
from ann_dc.network.network import Network

Derivatives = list[list[tuple[int, float]]]
"""Words and weights that move every neuron, before the factor h."""


def add_pyramid(
    derivatives: Derivatives, network: Network, tape: Tape, listing: Listing, drives: np.ndarray
) -> None:
    """Add the coarse levels' contributions to the derivatives; ``drives`` (P, N) are net inputs."""
    below = _drives_below(tape, drives)
    levels = list(zip(tape.grid_starts[:-1].tolist(), tape.grid_starts[1:].tolist()))
    names = [chain[0] for chain in network.cell.chains]
    grid = np.full(below.shape, ZERO)
    for level, (first, last) in enumerate(levels):
        rows = [listing.row(f"grid {level} of {name}") for name in names]
        for a, j in np.ndindex(last - first, len(names)):
            grid[first + a, j] = listing.word(rows[j])
            listing.sum(SUM, int(grid[first + a, j]), below[first + a, j])
            for point, share in _half(a, last) if level + 1 < len(levels) else ():
                below[point, j].append((int(grid[first + a, j]), share))
    rates = _responses(grid, levels, tape, names, listing)
    for p, j in np.ndindex(len(tape.hats), len(names)):
        left, share = int(tape.hats[p]), float(tape.shares[p])
        index = network.state_index[tape.chains[j, p & 1], p >> 1]
        if index >= 0:
            derivatives[index].append((int(rates[left, j]), 1.0 - share))
            derivatives[index].append((int(rates[left + 1, j]), share))


def _drives_below(tape: Tape, drives: np.ndarray) -> np.ndarray:
    """Return words and hat weights of the net inputs below every hat, by (grid point, chain)."""
    below = np.empty((int(tape.grid_starts[-1]), len(tape.chains)), object)
    for place in np.ndindex(below.shape):
        below[place] = []
    for p, j in np.ndindex(len(tape.hats), len(tape.chains)):
        left, share = int(tape.hats[p]), float(tape.shares[p])
        drive = int(drives[tape.chains[j, p & 1], p >> 1])
        below[left, j].append((drive, 1.0 - share))
        below[left + 1, j].append((drive, share))
    return below


def _responses(
    grid: np.ndarray,
    levels: list[tuple[int, int]],
    tape: Tape,
    names: list[str],
    listing: Listing,
) -> np.ndarray:
    """Return the words of the rates at grid points: gains plus the coarser levels."""
    rates = np.full(grid.shape, ZERO)
    for level in reversed(range(len(levels))):
        first, last = levels[level]
        rows = [listing.row(f"rate {level} of {name}") for name in names]
        for a, i in np.ndindex(last - first, len(names)):
            gains = tape.grids[first + a, i].tolist()
            edges = list(zip(grid[first + a].tolist(), gains))
            for point, share in _half(a, last) if level + 1 < len(levels) else ():
                edges.append((int(rates[point, i]), share))
            rates[first + a, i] = listing.word(rows[i])
            listing.sum(SUM, int(rates[first + a, i]), edges)
    return rates


def _half(a: int, above: int) -> list[tuple[int, float]]:
    """Return (point, weight) pairs of point ``a`` on the coarser level that begins at ``above``."""
    if a % 2:
        return [(above + a // 2, 0.5), (above + a // 2 + 1, 0.5)]
    return [(above + a // 2, 1.0)]
