"""Flow of a network for given inputs: drives, moves, residuals and derivatives.

States are tensors (P, N, B): neurons, stages, samples.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import torch

from ann_dc.backends.layers.layout import Layout
from ann_dc.backends.layers.preconditioners import Constants
from ann_dc.backends.layers.trained import CurrentLimits
from ann_dc.evaluation import rules
from ann_dc.evaluation.domains import side_of_pole
from ann_dc.network.functions import FUNCTIONS


class Reading(NamedTuple):
    """Block arguments and drives of a network at a state."""

    arguments: list[torch.Tensor]  # arguments, (N, B) or (N, 1) each, of the guarded blocks
    drives: torch.Tensor  # net inputs (P, N, B); zero for fixed, omitted or saturated neurons
    uncut: torch.Tensor | None = None
    """Drives (P, N, B), those of coupled neurons without saturation; None if the preconditioner
    couples no neuron with saturation limits.
    """

    @property
    def arriving(self) -> torch.Tensor:
        """Drives (P, N, B) to which the preconditioner is applied."""
        return self.drives if self.uncut is None else self.uncut


@dataclass(frozen=True, eq=False)
class Flow:
    """Flow dx/ds = M d(x) of a network for one batch of inputs, on which orders and loops work."""

    layout: Layout
    constants: Constants
    inputs: torch.Tensor
    first: int
    last: int
    limits: CurrentLimits

    def select(self, samples: torch.Tensor) -> Flow:
        """Return the flow of some of the samples, by indices (b,) or booleans (B,)."""
        if self.inputs.shape[-1] == 1:
            return self
        return replace(self, inputs=self.inputs[..., samples])

    def window(self, first: int, last: int) -> Flow:
        """Return the flow of the stages ``first .. last - 1``, cut off from the others."""
        weights, rates, grids = self.constants
        part = Constants(weights[:, first:last], rates[:, first:last], grids)
        return replace(
            self, constants=part, inputs=self.inputs[:, first:last], first=first, last=last
        )

    def read(self, state: torch.Tensor) -> Reading:
        """Return block arguments and drives at a state (P, N, B)."""
        layout = self.layout
        arguments, drives = layout.read(self.constants.weights, self.inputs, state)
        drives = layout.gathered(drives) * layout.live[:, self.first : self.last]
        if not layout.with_limits:
            return Reading(arguments, drives)
        cut = torch.where(self._pushes_out(state, drives), 0.0, drives)
        if not len(layout.clamped):
            return Reading(arguments, cut)
        return Reading(arguments, cut, torch.where(layout.coupled, drives, cut))

    def derivative(self, arriving: torch.Tensor, state: torch.Tensor) -> torch.Tensor:
        """Return dx/ds (P, N, B): the projection of M d on the admissible directions.

        The drives ``arriving`` (P, N, B) are those of `read`; the state determines the active
        limits.
        """
        layout = self.layout
        derivatives = layout.preconditioner(self.constants, arriving)
        if len(layout.clamped):
            derivatives = self._projected(derivatives, arriving, state)
        derivatives = layout.spread(derivatives * layout.live)
        return (
            torch.where(self._pushes_out(state, derivatives), 0.0, derivatives)
            if layout.with_limits
            else derivatives
        )

    def _projected(
        self, derivatives: torch.Tensor, arriving: torch.Tensor, state: torch.Tensor
    ) -> torch.Tensor:
        """Return moves with saturated neurons from those without; see `lane_clamps`.

        All samples exchange neurons in the same rounds; samples without a violation are not
        changed.
        """
        places, is_traced = self.layout.clamped, torch.compiler.is_compiling()
        x, rows = state.flatten(0, 1)[places], places // state.shape[1]
        low, high = self.layout.low[rows, 0], self.layout.high[rows, 0]
        if not is_traced:  # only those that stand at a rail in any sample
            near = ((x <= low) | (x >= high)).any(1)
            places, x, low, high = places[near], x[near], low[near], high[near]
        order = torch.arange(len(places), device=x.device)

        def exchanged(turn, held, wrong, arriving, x):
            last = torch.where(wrong, order[:, None], -1).amax(0)
            held = held ^ (wrong & ((order[:, None] == last) | (turn < rules.BLOCKS)))
            clamped: Any = self.layout.preconditioner.clamped
            derivatives, currents = clamped(self.constants, arriving, places, held)
            given, found = arriving.flatten(0, 1)[places], derivatives.flatten(0, 1)[places]
            size = torch.where(held, given.abs() + currents.abs(), 0.0).amax(0)
            lets_go = rules.lets_go(x, currents, low, high, rules.ROUNDING * size)
            return (
                held,
                torch.where(held, lets_go, rules.pushes_out(x, found, low, high)),
                derivatives,
            )

        held = torch.zeros_like(x, dtype=torch.bool)
        wrong, turn = rules.pushes_out(x, derivatives.flatten(0, 1)[places], low, high), 0
        if is_traced:
            return torch.while_loop(
                lambda turn, held, wrong, derivatives: wrong.any() & (turn < rules.PIVOTS),
                lambda turn, held, wrong, derivatives: (
                    turn + 1,
                    *exchanged(turn, held, wrong, arriving, x),
                ),
                (order.new_zeros(()), held, wrong, derivatives),
            )[-1]
        while turn < rules.PIVOTS and wrong.any():
            some = wrong.any(0).nonzero()[:, 0]
            parts = (tensor[..., some] for tensor in (held, wrong, arriving, x))
            found = exchanged(turn, *parts)
            held, wrong, derivatives = (
                whole.index_copy(-1, some, part)
                for whole, part in zip((held, torch.zeros_like(wrong), derivatives), found)
            )
            turn += 1
        return derivatives

    def _pushes_out(self, state: torch.Tensor, push: torch.Tensor) -> torch.Tensor:
        return rules.pushes_out(state, push, self.layout.low, self.layout.high)

    def within_limits(self, state: torch.Tensor) -> torch.Tensor:
        """Return the state clipped to the saturation limits."""
        layout = self.layout
        return state.clamp(layout.low, layout.high) if layout.with_limits else state

    def saturated(self, state: torch.Tensor) -> torch.Tensor:
        """Return a mask (B, n) of neurons at a saturation limit whose drive is cut off."""
        layout, drives = self.layout, self.read(state).drives
        return layout.pack(rules.is_saturated(state, drives, layout.low, layout.high))

    def residuals(self, state: torch.Tensor, drives: torch.Tensor) -> torch.Tensor:
        """Return the relative residuals (2, B) at a state; see `rules.residuals`."""
        return rules.residuals(torch, self.layout.roles, drives, state)

    def defined(
        self, arguments: list[torch.Tensor], signs: list[torch.Tensor]
    ) -> list[torch.Tensor]:
        """Return masks, (N, B) or (N, 1) each, of defined guarded function blocks."""
        return [
            rules.is_defined(argument, *FUNCTIONS[code].domain, sign)
            for (_, code, _), argument, sign in zip(self.layout.tape.guarded, arguments, signs)
        ]

    def outside(self, reading: Reading, signs: list[torch.Tensor]) -> torch.Tensor:
        """Return a mask (B,) of samples with a function block outside its domain.

        ``signs`` are those of `domain_signs` at the start: a reciprocal must not change its side.
        """
        outside = torch.zeros_like(reading.drives[0, 0], dtype=torch.bool)
        for inside in self.defined(reading.arguments, signs):
            outside = outside | ~inside.all(0)
        return outside

    def domain_signs(self, reading: Reading) -> list[torch.Tensor]:
        """Return each reciprocal's side of its pole; zero for other blocks."""
        return [
            side_of_pole(argument, torch)
            if FUNCTIONS[code].has_pole
            else torch.zeros_like(argument)
            for (_, code, _), argument in zip(self.layout.tape.guarded, reading.arguments)
        ]

    def jacobian_entries(self, state: torch.Tensor) -> torch.Tensor:
        """Return d drive / dx (nnz, B), in the order of ``tape.entries``; zero at a limit."""
        layout = self.layout
        slots = layout.tape.derivatives(self.constants.weights, self.inputs, state)
        rows, _, slot, stage = layout.entries.unbind(1)
        table = torch.stack([s.expand(state.shape[1:]) for s in slots])
        entries = table[slot, stage]
        if layout.with_limits:
            entries = torch.where(self.saturated(state).T[rows], 0.0, entries)
        return entries
