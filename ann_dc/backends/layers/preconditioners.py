"""Preconditioners in torch: the effect of a drive on other neurons.

A pyramid restricts drives of t and q to coarse grids over the stage axis and prolongs the result. A
stiffness is solved by elimination, level by level, for a grid and a tree alike.

While neurons are saturated (`ann_dc.evaluation`), every sample has a separate stiffness, which is
eliminated anew. Under a pyramid, M among the saturated neurons is inverted.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from torch import nn
from torch.nn.functional import pad

from ann_dc.backends.layers.fixed_order import applied, inverted, product, total
from ann_dc.evaluation.tape import Tape
from ann_dc.network.preconditioners.base import ArrayLayout
from ann_dc.network.preconditioners.elimination import Level, blocks_of, eliminate
from ann_dc.network.preconditioners.stiffness import Stiffness


class Constants(NamedTuple):
    """Numbers of a network with its trained gains, in network units."""

    weights: torch.Tensor  # weights (E, N, 1) of the connections, in the order of the tape
    rates: torch.Tensor  # rates 1 / tau (P, N, 1), zero for a fixed or omitted neuron
    grids: torch.Tensor  # gains (G, C, C) of the coordinators, finest level first


class PyramidLayer(nn.Module):
    """Contribution of the coordinators of a tape to the moves of its chains.

    ``sizes`` are the numbers of points of every level, finest first.
    """

    chain: torch.Tensor
    left: torch.Tensor
    share: torch.Tensor
    heard: torch.Tensor
    weight: torch.Tensor

    def __init__(self, tape: Tape, stages: int, *, dtype: torch.dtype) -> None:
        super().__init__()
        self.sizes = [int(b - a) for a, b in zip(tape.grid_starts[:-1], tape.grid_starts[1:])]
        positions = np.arange(2 * stages)
        # flat places of q_0, t_0, q_1, ...: position by position, the C components of each together
        rows = tape.chains[:, positions % 2].T * stages + (positions // 2)[:, None]
        heard, weight = _hats(tape, self.sizes[0])
        tables = {
            "chain": torch.as_tensor(rows.ravel()),
            "left": torch.as_tensor(tape.hats),
            "share": torch.as_tensor(tape.shares, dtype=dtype)[:, None],
            "heard": torch.as_tensor(heard),
            "weight": torch.as_tensor(weight, dtype=dtype)[:, :, None],
        }
        for name, table in tables.items():
            self.register_buffer(name, table, persistent=False)

    def forward(self, constants: Constants, drives: torch.Tensor) -> torch.Tensor:
        """Return M d (P, N, B), for drives (P, N, B)."""
        derivatives = drives * constants.rates
        samples = drives.shape[-1]
        chain = drives.flatten(0, 1)[self.chain].reshape(len(self.left), -1)
        grid = self._down(chain).reshape(self.sizes[0], -1, samples)
        up = self._up(self._respond(constants.grids, grid).flatten(1))
        added = derivatives.flatten(0, 1).index_add(0, self.chain, up.reshape(-1, samples))
        return added.reshape(derivatives.shape)

    def clamped(
        self, constants: Constants, drives: torch.Tensor, places: torch.Tensor, held: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """Return moves (P, N, B) and currents (K, B) while some neurons are saturated.

        ``places`` (K,) are indices, in a flattened (P, N), of neurons with limits; ``held`` (K, B)
        marks the saturated ones.
        """
        unit, marks = torch.eye(len(places)).to(drives), held.to(drives.dtype)
        units = drives.new_zeros(drives[..., 0].numel(), len(places)).index_copy(0, places, unit)
        units = units.reshape(*drives.shape[:2], -1)
        within = self(constants, units).flatten(0, 1)[places][..., None]
        matrix = within * marks[:, None] * marks + unit[..., None] * (1 - marks)
        pull = self(constants, drives).flatten(0, 1)[places]
        currents = -applied(inverted(matrix), pull * marks) * marks
        pushed = drives.flatten(0, 1).index_add(0, places, currents).reshape(drives.shape)
        derivatives = self(constants, pushed).flatten(0, 1)
        derivatives = derivatives.index_copy(0, places, derivatives[places] * (1 - marks))
        return derivatives.reshape(drives.shape), currents

    def _down(self, chain: torch.Tensor) -> torch.Tensor:
        """Return the restriction (points, C B) of a chain (2 N, C B) to the finest level."""
        return total(self.weight * chain[self.heard])

    def _up(self, derivative: torch.Tensor) -> torch.Tensor:
        """Apply the transpose of `_down`."""
        return (1 - self.share) * derivative[self.left] + self.share * derivative[self.left + 1]

    def _respond(self, grids: torch.Tensor, grid: torch.Tensor) -> torch.Tensor:
        """Return rates (points, C, B) of the coarse neurons, summed on the finest level."""
        rates = []
        for gain in grids.split(self.sizes):
            rates.append(applied(gain, grid))
            grid = _coarsened(grid)
        derivative = rates.pop()
        while rates:
            derivative = rates.pop() + _refined(derivative)
        return derivative


def _hats(tape: Tape, points: int) -> tuple[np.ndarray, np.ndarray]:
    """Return positions and weights (heard, points) of each point of the finest level."""
    hats = np.zeros((points, len(tape.hats)))
    positions = np.arange(len(tape.hats))
    hats[tape.hats, positions] = 1 - tape.shares
    hats[tape.hats + 1, positions] += tape.shares
    most = max(int((hats != 0).sum(1).max()), 1)
    heard = np.argsort(hats == 0, axis=1, kind="stable")[:, :most].T  # those that it hears go first
    return heard.copy(), hats.T[heard, np.arange(points)]


def _coarsened(grid: torch.Tensor) -> torch.Tensor:
    between = 0.5 * grid[1::2]
    none = torch.zeros_like(grid[:1])
    return grid[0::2] + torch.cat([between, none]) + torch.cat([none, between])


def _refined(coarse: torch.Tensor) -> torch.Tensor:
    between = 0.5 * (coarse[:-1] + coarse[1:])
    pairs = torch.stack([coarse[:-1], between], dim=1).flatten(0, 1)
    return torch.cat([pairs, coarse[-1:]])


class EliminationLayer(nn.Module):
    """Moves of a network whose preconditioner is the inverse of a stiffness.

    A move stores some six tensors of the size of the primal neurons' state at a time. In reverse
    mode it stores all of them: the drives of every level, their solutions, and both halves.
    ``is_clamped`` is true if coupled neurons have saturation limits.
    """

    places: torch.Tensor
    present: torch.Tensor
    alone: torch.Tensor
    own: torch.Tensor
    following: torch.Tensor

    def __init__(
        self,
        stiffness: Stiffness,
        row: ArrayLayout,
        *,
        dtype: torch.dtype,
        is_clamped: bool = False,
    ) -> None:
        super().__init__()
        found = eliminate(stiffness, row)
        flat = np.flatnonzero(row.rates.T > 0)  # of the state vector, by stage
        stage, neuron = np.divmod(flat, len(row.rates))
        component = found.component.ravel()
        self.size = found.component.shape[1]
        tables = {
            "places": torch.as_tensor((neuron * row.stages + stage)[component]),
            "present": torch.as_tensor(component >= 0)[:, None].to(dtype),
            "alone": torch.as_tensor(~stiffness.reach(row))[:, None, None].to(dtype),
        }
        for number, level in enumerate(found.levels):
            down, up = _stacked(level)
            tables[f"down_{number}"] = torch.as_tensor(down, dtype=dtype)
            tables[f"up_{number}"] = torch.as_tensor(up, dtype=dtype)
        self.depth = len(found.levels)
        if is_clamped:
            _, own, following = blocks_of(stiffness, row)
            tables["own"] = torch.as_tensor(own, dtype=dtype)[..., None]
            tables["following"] = _padded(torch.as_tensor(following, dtype=dtype), 0, 1)[..., None]
        for name, table in tables.items():
            self.register_buffer(name, table, persistent=False)

    def forward(self, constants: Constants, drives: torch.Tensor) -> torch.Tensor:
        """Return M d (P, N, B), for drives (P, N, B)."""
        root = self._root(constants)
        pushed = (drives.flatten(0, 1)[self.places] * root).unflatten(0, (-1, self.size))
        solved = self._solve(pushed, self._levels).flatten(0, 1) * root
        return self._placed(constants, drives, solved)

    def clamped(
        self, constants: Constants, drives: torch.Tensor, places: torch.Tensor, held: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """Return moves and currents as `PyramidLayer.clamped` does."""
        root, of_block = self._root(constants), (-1, self.size)
        marks = torch.zeros_like(drives).flatten(0, 1)
        marks = marks.index_copy(0, places, held.to(drives.dtype))[self.places] * self.present
        marks = marks.unflatten(0, of_block)
        free, unit = 1 - marks, torch.eye(self.size).to(drives)[..., None]
        own, following = self.own, self.following[:-1]
        own_free = own * free[:, :, None] * free[:, None] + unit * marks[:, None]
        following_free = following * free[:-1, :, None] * free[1:, None]
        pushed = (drives.flatten(0, 1)[self.places] * root).unflatten(0, of_block) * free
        solved = self._solve(pushed, _eliminated(own_free, following_free)) * free
        pull = applied(own, solved)
        pull = pull + _padded(applied(following, solved[1:]), 0, 1)
        pull = pull + _padded(applied(following.transpose(1, 2), solved[:-1]), 1, 0)
        pull = pull.flatten(0, 1) * self.present / (root + (1 - self.present))
        pull = torch.zeros_like(drives).flatten(0, 1).index_add(0, self.places, pull)[places]
        currents = torch.where(held, pull - drives.flatten(0, 1)[places], 0.0)
        return self._placed(constants, drives, solved.flatten(0, 1) * root), currents

    def _root(self, constants: Constants) -> torch.Tensor:
        """Return T^{1/2} (blocks b, 1) of the neurons of every block; zero if missing."""
        return torch.sqrt(constants.rates.flatten(0, 1)[self.places]) * self.present

    def _placed(
        self, constants: Constants, drives: torch.Tensor, solved: torch.Tensor
    ) -> torch.Tensor:
        """Return moves (P, N, B) from the solution (blocks b, B) and uncoupled rates."""
        derivatives = drives * (constants.rates * self.alone)
        return derivatives.flatten(0, 1).index_add(0, self.places, solved).reshape(drives.shape)

    @property
    def _levels(self) -> list[tuple[torch.Tensor, torch.Tensor]]:
        """Tables of all levels, in the form of `_stacked`."""
        numbers = range(self.depth)
        return [(getattr(self, f"down_{n}"), getattr(self, f"up_{n}")) for n in numbers]

    def _solve(
        self, rest: torch.Tensor, levels: list[tuple[torch.Tensor, torch.Tensor]]
    ) -> torch.Tensor:
        """Solve for drives (blocks, b, B), as `Elimination.solve` does."""
        done = []
        for down, _ in levels:
            ready, rest = rest[0::2], rest[1::2]
            own, on_left, on_right = self._parts(down, ready)
            done.append(own)
            if len(rest):
                behind = on_right[1:]
                rest = rest - on_left[: len(rest)]
                rest = torch.cat([rest[: len(behind)] - behind, rest[len(behind) :]])
        solved = done.pop()
        for _, up in reversed(levels[:-1]):
            own, none = done.pop(), torch.zeros_like(solved[:1])
            ahead, behind = self._parts(up, solved)
            missing = len(own) - len(ahead)
            own = own - torch.cat([ahead, none[:missing]])
            own = own - torch.cat([none, behind[: len(own) - 1]])
            if missing:
                pairs = torch.stack([own[:-1], solved], dim=1).flatten(0, 1)
                solved = torch.cat([pairs, own[-1:]])
            else:
                solved = torch.stack([own, solved], dim=1).flatten(0, 1)
        return solved

    def _parts(self, table: torch.Tensor, vectors: torch.Tensor) -> tuple[torch.Tensor, ...]:
        """Return the parts of a table's product with vectors, all (blocks, b, B)."""
        return applied(table, vectors).unflatten(1, (-1, self.size)).unbind(1)


def _eliminated(
    own: torch.Tensor, following: torch.Tensor
) -> list[tuple[torch.Tensor, torch.Tensor]]:
    """Return tables of all levels as `_stacked` does, from blocks (blocks, b, b, B)."""
    levels, size = [], own.shape[1]
    while True:
        inverse, odd = inverted(own[0::2]), len(own) // 2
        ahead = _padded(following[0::2], 0, len(inverse) - odd)
        beside = torch.cat([ahead, _padded(following[1::2].transpose(1, 2), 1, 0)], dim=2)
        hats = product(beside.transpose(1, 2), inverse)
        left, right = hats[:odd, :size].transpose(1, 2), hats[1:, size:].transpose(1, 2)
        missing = odd - len(right)
        up = torch.cat([left, _padded(right, 0, missing)], dim=1)
        levels.append((torch.cat([inverse, hats], dim=1), up))
        if not odd:
            return levels
        fill = product(hats, beside)
        own = own[1::2] - fill[:odd, :size, :size] - _padded(fill[1:, size:, size:], 0, missing)
        following = -fill[1:odd, size:, :size]


def _padded(rows: torch.Tensor, before: int, after: int) -> torch.Tensor:
    """Return the rows with given numbers of zero rows on either side."""
    return pad(rows, (0,) * 2 * (rows.dim() - 1) + (before, after))


def _stacked(level: Level) -> tuple[np.ndarray, np.ndarray]:
    """Return a level's stacked matrices: inverse, left, right; transposes of left and right.

    One product with all of them is faster than three. Missing neighbours are zeros.
    """
    inverse, left, right = level.inverse, level.left, level.right
    on_left, on_right = np.zeros_like(inverse), np.zeros_like(inverse)
    on_left[: len(left)], on_right[1:] = left, right
    back = np.zeros_like(left)
    back[: len(right)] = right.transpose(0, 2, 1)
    down = np.concatenate([inverse, on_left, on_right], axis=1)
    return down, np.concatenate([left.transpose(0, 2, 1), back], axis=1)


class TimeConstantsLayer(nn.Module):
    """Moves of a network with time constants alone."""

    def forward(self, constants: Constants, drives: torch.Tensor) -> torch.Tensor:
        """Return M d (P, N, B), for drives (P, N, B)."""
        return drives * constants.rates
