"""The flow of a network for given inputs: drives, moves, residuals, derivatives.

A `Flow` is a cell layer with its constants read once and its inputs filled in; every update order
and every loop works on one. States are tensors (P, N, B): neurons, stages, samples.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import torch

from ann_dc.evaluation.loops import FLOOR
from ann_dc.network.functions import CODE, FUNCTIONS

if TYPE_CHECKING:
    from ann_dc.backends.recurrent.cell.layer import CellLayer


class Constants(NamedTuple):
    """Numbers of a network, with its trained gains in them."""

    weights: torch.Tensor
    """(E, N, 1)."""
    rates: torch.Tensor
    """(P, N, 1): 1 / tau, zero where a neuron is pinned or absent."""
    grids: torch.Tensor
    """(G, C, C): gains of the coordinators, finest level first."""


class Reading(NamedTuple):
    """What the blocks of a network say at a state."""

    arguments: list[torch.Tensor]
    """What goes into each function block that has a limited domain, (N, B) or (N, 1)."""
    drives: torch.Tensor
    """(P, N, B): what arrives at the neurons; zero where one is pinned, absent or at its rail."""


@dataclass(frozen=True, eq=False)
class Flow:
    """dx/ds = M d(x) of a cell layer for one batch of inputs.

    Attributes
    ----------
    cell : CellLayer
    constants : Constants
    inputs : (I, N, B) or (I, N, 1) tensor
    first, last : int
        The stages that are evaluated; all of them, except in a `window`.
    """

    cell: CellLayer
    constants: Constants
    inputs: torch.Tensor
    first: int
    last: int

    def select(self, samples: torch.Tensor) -> Flow:
        """The same flow for some of its samples."""
        if self.inputs.shape[-1] == 1:
            return self
        return replace(self, inputs=self.inputs[..., samples])

    def window(self, first: int, last: int) -> Flow:
        """The flow of the stages ``first .. last - 1``, cut off from the others."""
        weights, rates, grids = self.constants
        part = Constants(weights[:, first:last], rates[:, first:last], grids)
        return replace(
            self, constants=part, inputs=self.inputs[:, first:last], first=first, last=last
        )

    def read(self, state: torch.Tensor) -> Reading:
        """Blocks and drives at a state (P, N, B)."""
        cell = self.cell
        arguments, drives = cell.read(self.constants.weights, self.inputs, state)
        drives = drives * cell.live[:, self.first : self.last]
        if cell.railed:
            drives = torch.where(self._outward(state, drives), 0.0, drives)
        return Reading(arguments, drives)

    def move(self, drives: torch.Tensor, state: torch.Tensor) -> torch.Tensor:
        """M d (P, N, B): time constants and coordinators; none of them moves past a rail."""
        cell, moves = self.cell, drives * self.constants.rates
        if cell.pyramid is None:
            return moves
        moves = cell.pyramid(self.constants.grids, drives, moves) * cell.live
        return torch.where(self._outward(state, moves), 0.0, moves) if cell.railed else moves

    def _outward(self, state: torch.Tensor, push: torch.Tensor) -> torch.Tensor:
        """Where a neuron at its rail is pushed further."""
        cell = self.cell
        return ((state <= cell.low) & (push < 0)) | ((state >= cell.high) & (push > 0))

    def within_rails(self, state: torch.Tensor) -> torch.Tensor:
        """The state with every neuron between its rails."""
        return state.clamp(self.cell.low, self.cell.high) if self.cell.railed else state

    def residuals(self, state: torch.Tensor, drives: torch.Tensor) -> torch.Tensor:
        """Relative (constraint, stationarity) residuals (2, B), infinite where not finite.

        The same measure as `ann_dc.evaluation.loops.residuals`.
        """
        cell = self.cell
        drive, value = drives.abs().amax(1), state.abs().amax(1)

        def largest(rows: torch.Tensor, of: torch.Tensor, least: float) -> torch.Tensor:
            if len(rows) == 0:
                return torch.full_like(of[0], least)
            return of[rows].amax(0).clamp(min=least)

        constraint = largest(cell.duals, drive, 0.0) / largest(cell.positions, value, FLOOR)
        stationarity = largest(cell.primal, drive, 0.0) / largest(cell.duals, value, FLOOR)
        still = largest(cell.states, drive, 0.0) / largest(cell.states, value, 1.0)
        both = torch.stack([constraint, torch.maximum(stationarity, still)])
        return torch.where(both.isfinite(), both, torch.inf)

    def outside(self, reading: Reading, signs: list[torch.Tensor]) -> torch.Tensor:
        """(B,) booleans: whether a function block is outside its domain.

        ``signs`` are those of `domain_signs` at the start: a reciprocal must stay on its side.
        """
        outside = torch.zeros_like(reading.drives[0, 0], dtype=torch.bool)
        for (code, _), argument, sign in zip(self.cell.wiring.guarded, reading.arguments, signs):
            low, high = FUNCTIONS[code].domain
            inside = (argument > low) & (argument < high)
            inside &= (sign == 0) | (argument * sign > 0)
            outside = outside | ~inside.all(0)
        return outside

    def domain_signs(self, reading: Reading) -> list[torch.Tensor]:
        """Side of its pole on which each reciprocal's argument is; zero for other blocks."""
        return [
            argument.sign() if code == CODE["reciprocal"] else torch.zeros_like(argument)
            for (code, _), argument in zip(self.cell.wiring.guarded, reading.arguments)
        ]

    def resting(self, state: torch.Tensor) -> torch.Tensor:
        """(B, n) booleans: which neurons stand at a rail with their drive cut off."""
        at_rail = (state <= self.cell.low) | (state >= self.cell.high)
        return self.cell.pack(at_rail & (self.read(state).drives == 0))

    def jacobian_entries(self, state: torch.Tensor) -> torch.Tensor:
        """Entries of d drive / dx (nnz, B), in the order of ``tape.entries``; zero at a rail."""
        cell = self.cell
        slots = cell.wiring.derivatives(self.constants.weights, self.inputs, state)
        rows, _, slot, stage = cell.entries.unbind(1)
        table = torch.stack([s.expand(state.shape[1:]) for s in slots])
        entries = table[slot, stage]
        if cell.railed:
            entries = torch.where(self.resting(state).T[rows], 0.0, entries)
        return entries
