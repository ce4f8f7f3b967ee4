"""The metrics in torch: what a drive moves besides its own neuron.

A pyramid goes down to t and q and back up over the stage axis: the hats of the finest level are a
matrix while it is small, every coarser level is halves of the one before. A stiffness is solved by
elimination, level by level, whether it is built as a grid or as a tree. See
`ann_dc.network.preconditioners`.

While neurons are held at rails (`ann_dc.evaluation`), every sample has a stiffness of its
own, which is eliminated anew; under a pyramid, M among the held neurons is inverted.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from torch import nn
from torch.nn.functional import pad

from ann_dc.backends.recurrent.cell.fixed_order import applied, inverted, product, total
from ann_dc.evaluation.tape import Tape
from ann_dc.network.preconditioners.base import Row
from ann_dc.network.preconditioners.elimination import Level, blocks_of, eliminate
from ann_dc.network.preconditioners.stiffness import Stiffness


class Constants(NamedTuple):
    """Numbers of a network, with its trained gains in them; all in network units."""

    weights: torch.Tensor
    """(E, N, 1): weights of the connections, in the order of the tape."""
    rates: torch.Tensor
    """(P, N, 1): 1 / tau, zero where a neuron is pinned or absent."""
    grids: torch.Tensor
    """(G, C, C): gains of the coordinators, finest level first."""


class PyramidLayer(nn.Module):
    """What the coordinators of a tape add to the moves of its chains.

    Parameters
    ----------
    tape : Tape
        Of a network with coordinators.
    stages : int
        N.
    dtype : torch.dtype

    Attributes
    ----------
    sizes : list of int
        Points of every level, finest first.
    chain : (2 N C,) tensor
        Places of q_0, t_0, q_1, ... in a flattened (P, N), the C components of each together.
    left : (2 N,) tensor
        Point of the finest level to the left of every position.
    share : (2 N, 1) tensor
        Of the way to the point on its right.
    heard : (heard, points) tensor
        The positions that every point of the finest level hears, any position where it hears fewer.
    weight : (heard, points, 1) tensor
        How much of each.
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
        """M d (P, N, B), for drives (P, N, B)."""
        moves = drives * constants.rates
        samples = drives.shape[-1]
        chain = drives.flatten(0, 1)[self.chain].reshape(len(self.left), -1)
        grid = self._down(chain).reshape(self.sizes[0], -1, samples)
        up = self._up(self._respond(constants.grids, grid).flatten(1))
        added = moves.flatten(0, 1).index_add(0, self.chain, up.reshape(-1, samples))
        return added.reshape(moves.shape)

    def clamped(
        self, constants: Constants, drives: torch.Tensor, places: torch.Tensor, held: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """Moves (P, N, B) and currents (K, B) while neurons at some places are held.

        Parameters
        ----------
        constants : Constants
        drives : (P, N, B) tensor
        places : (K,) tensor
            In a flattened (P, N), of neurons with rails.
        held : (K, B) tensor of bool
        """
        unit, marks = torch.eye(len(places)).to(drives), held.to(drives.dtype)
        units = drives.new_zeros(drives[..., 0].numel(), len(places)).index_copy(0, places, unit)
        units = units.reshape(*drives.shape[:2], -1)
        within = self(constants, units).flatten(0, 1)[places][..., None]
        matrix = within * marks[:, None] * marks + unit[..., None] * (1 - marks)
        pull = self(constants, drives).flatten(0, 1)[places]
        currents = -applied(inverted(matrix), pull * marks) * marks
        pushed = drives.flatten(0, 1).index_add(0, places, currents).reshape(drives.shape)
        moves = self(constants, pushed).flatten(0, 1)
        moves = moves.index_copy(0, places, moves[places] * (1 - marks))
        return moves.reshape(drives.shape), currents

    def _down(self, chain: torch.Tensor) -> torch.Tensor:
        """What the points of the finest level hear (points, C B) of a chain (2 N, C B)."""
        return total(self.weight * chain[self.heard])

    def _up(self, move: torch.Tensor) -> torch.Tensor:
        """The transpose of `_down`."""
        return (1 - self.share) * move[self.left] + self.share * move[self.left + 1]

    def _respond(self, grids: torch.Tensor, grid: torch.Tensor) -> torch.Tensor:
        """Rates (points, C, B) of the coarse neurons of all levels, added up on the finest."""
        rates = []
        for gain in grids.split(self.sizes):
            rates.append(applied(gain, grid))
            grid = _coarsened(grid)
        move = rates.pop()
        while rates:
            move = rates.pop() + _refined(move)
        return move


def _hats(tape: Tape, points: int) -> tuple[np.ndarray, np.ndarray]:
    """(heard, points): which positions each point of the finest level hears, and how much."""
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
    """Moves of a network whose metric is the inverse of a stiffness.

    A move holds some six tensors of the size of the primal neurons' state at a time, and in
    reverse mode all of them: the drives of every level, what is solved of them, and both halves.

    Parameters
    ----------
    stiffness : Stiffness
    row : Row
        Of the network.
    dtype : torch.dtype
    is_clamped : bool
        True if neurons that it couples have rails.

    Attributes
    ----------
    places : (blocks b,) tensor
        Where the neurons of every block are in a flattened (P, N); any place where there is none.
    present : (blocks b, 1) tensor
        One where there is a neuron, else zero.
    alone : (P, 1, 1) tensor
        One where a neuron moves with its own drive alone, else zero.
    own, following : (blocks, b, b, 1) tensors
        S of every block, and between it and the next, if ``is_clamped``.
    """

    places: torch.Tensor
    present: torch.Tensor
    alone: torch.Tensor
    own: torch.Tensor
    following: torch.Tensor

    def __init__(
        self, stiffness: Stiffness, row: Row, *, dtype: torch.dtype, is_clamped: bool = False
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
        """M d (P, N, B), for drives (P, N, B)."""
        root = self._root(constants)
        pushed = (drives.flatten(0, 1)[self.places] * root).unflatten(0, (-1, self.size))
        solved = self._solve(pushed, self._levels).flatten(0, 1) * root
        return self._placed(constants, drives, solved)

    def clamped(
        self, constants: Constants, drives: torch.Tensor, places: torch.Tensor, held: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """As `PyramidLayer.clamped`."""
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
        """T^{1/2} (blocks b, 1) of the neurons of every block; zero where there is none."""
        return torch.sqrt(constants.rates.flatten(0, 1)[self.places]) * self.present

    def _placed(
        self, constants: Constants, drives: torch.Tensor, solved: torch.Tensor
    ) -> torch.Tensor:
        """Moves (P, N, B): what is solved (blocks b, B), and rates of the neurons beside."""
        moves = drives * (constants.rates * self.alone)
        return moves.flatten(0, 1).index_add(0, self.places, solved).reshape(drives.shape)

    @property
    def _levels(self) -> list[tuple[torch.Tensor, torch.Tensor]]:
        """Tables of all levels, as `_stacked` has them."""
        numbers = range(self.depth)
        return [(getattr(self, f"down_{n}"), getattr(self, f"up_{n}")) for n in numbers]

    def _solve(
        self, rest: torch.Tensor, levels: list[tuple[torch.Tensor, torch.Tensor]]
    ) -> torch.Tensor:
        """`Elimination.solve`, of drives (blocks, b, B)."""
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
        """The parts, (blocks, b, B) each, of a table's product with vectors (blocks, b, B)."""
        return applied(table, vectors).unflatten(1, (-1, self.size)).unbind(1)


def _eliminated(
    own: torch.Tensor, following: torch.Tensor
) -> list[tuple[torch.Tensor, torch.Tensor]]:
    """`eliminate` for blocks (blocks, b, b, B): tables of all levels, as `_stacked` has them."""
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
    """The rows with so many rows of zeros on either side."""
    return pad(rows, (0,) * 2 * (rows.dim() - 1) + (before, after))


def _stacked(level: Level) -> tuple[np.ndarray, np.ndarray]:
    """A level's matrices one below the other: inverse, left, right; and the latter two transposed.

    One product with all of them is quicker than three; zeros stand where there is no neighbour.
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
        """M d (P, N, B), for drives (P, N, B)."""
        return drives * constants.rates
