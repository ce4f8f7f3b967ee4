"""The coarse coordinators in torch: down to t and q, and back up, over the stage axis.

The hats of the finest level are one small matrix; every coarser level is halves of the one before.
See `ann_dc.network.coordinators`.
"""

from __future__ import annotations

import numpy as np
import torch
from torch import nn

from ann_dc.evaluation.tape import Tape


class Pyramid(nn.Module):
    """What the coordinators of a tape add to the moves of its chains."""

    chain: torch.Tensor
    hats: torch.Tensor

    def __init__(self, tape: Tape, stages: int, *, dtype: torch.dtype) -> None:
        super().__init__()
        self.sizes = [int(b - a) for a, b in zip(tape.grid_starts[:-1], tape.grid_starts[1:])]
        positions = np.arange(2 * stages)
        # flat places of q_0, t_0, q_1, ...: position by position, the C components of each together
        rows = tape.chains[:, positions % 2].T * stages + (positions // 2)[:, None]
        hats = np.zeros((self.sizes[0], len(positions)))
        hats[tape.hats, positions] = 1 - tape.shares
        hats[tape.hats + 1, positions] += tape.shares
        self.register_buffer("chain", torch.as_tensor(rows.ravel()), persistent=False)
        self.register_buffer("hats", torch.as_tensor(hats, dtype=dtype), persistent=False)

    def forward(
        self, grids: torch.Tensor, drives: torch.Tensor, moves: torch.Tensor
    ) -> torch.Tensor:
        """Moves (P, N, B) and what the coordinators add, for drives (P, N, B).

        ``grids`` (G, C, C) are the gains.
        """
        samples = drives.shape[-1]
        chain = drives.flatten(0, 1)[self.chain].reshape(self.hats.shape[1], -1)
        grid = (self.hats @ chain).reshape(self.sizes[0], -1, samples)
        up = self.hats.T @ self._respond(grids, grid).flatten(1)
        added = moves.flatten(0, 1).index_add(0, self.chain, up.reshape(-1, samples))
        return added.reshape(moves.shape)

    def _respond(self, grids: torch.Tensor, grid: torch.Tensor) -> torch.Tensor:
        """Rates (points, C, B) of the coarse neurons of all levels, added up on the finest."""
        rates = []
        for gain in grids.split(self.sizes):
            rates.append(gain @ grid)
            grid = _coarsened(grid)
        move = rates.pop()
        while rates:
            move = rates.pop() + _refined(move)
        return move


def _coarsened(grid: torch.Tensor) -> torch.Tensor:
    between = 0.5 * grid[1::2]
    none = torch.zeros_like(grid[:1])
    return grid[0::2] + torch.cat([between, none]) + torch.cat([none, between])


def _refined(coarse: torch.Tensor) -> torch.Tensor:
    between = 0.5 * (coarse[:-1] + coarse[1:])
    pairs = torch.stack([coarse[:-1], between], dim=1).flatten(0, 1)
    return torch.cat([pairs, coarse[-1:]])
