"""Structure of a network as tensors: live neurons, roles, limits, places, domains.

A state is a tensor (P, N, B): neurons, stages, samples. It includes fixed and omitted neurons, so
that every sample has the same rows. `Layout.pack` removes these neurons; `Layout.fill` restores
them.
"""

from __future__ import annotations

import numpy as np
import torch
from torch import nn

from ann_dc.backends.layers.preconditioners import (
    EliminationLayer,
    PyramidLayer,
    TimeConstantsLayer,
)
from ann_dc.backends.layers.tape import TorchTape
from ann_dc.evaluation.reference import evaluator
from ann_dc.evaluation.rules import RoleRows
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.multilevel import Multilevel
from ann_dc.network.preconditioners.stiffness import Stiffness
from ann_dc.network.selection import clamped_rows


class Layout(nn.Module):
    """Structure of a network without trainable numbers; tables other than indices have a dtype."""

    live: torch.Tensor  # factor (P, N, 1): one for a live neuron, else zero
    low: torch.Tensor  # lower saturation limits (P, 1, 1) in network units, or minus infinity
    high: torch.Tensor  # upper saturation limits (P, 1, 1)
    coupled: torch.Tensor  # mask (P, 1, 1) of neurons that also move with drives of others
    clamped: torch.Tensor  # places (K,) in a flattened (P, N) of coupled neurons with limits
    places: torch.Tensor  # place (n,) of every component of a state vector in a flattened (P, N)
    pins: torch.Tensor  # place, row of the input and stage of every fixed neuron, (pins, 3)
    input_scales: torch.Tensor  # factor and offset (I, 2) of every input
    entries: torch.Tensor  # jacobian entries (nnz, 4) as on the tape
    shared: torch.Tensor  # rows of the neurons common to all cells, repeated in every cell
    duals: torch.Tensor  # rows of the neurons that are multipliers (mu, beta)
    primal: torch.Tensor  # rows of the neurons that minimise (q, u, t)
    positions: torch.Tensor  # rows of the chain neurons among them (q, t)
    states: torch.Tensor  # rows of the neurons of a network that is not an optimiser

    def __init__(self, network: Network, *, dtype: torch.dtype) -> None:
        super().__init__()
        self.network, self.tape = network, TorchTape.of(network)
        self._read = self.tape.read
        numbers = evaluator(network).tape
        self.preconditioner = _preconditioner_layer(network, dtype)
        self.with_limits = bool(np.isfinite(numbers.limits).any())
        tables = {
            "live": torch.as_tensor(network.live[:, :, None]).to(dtype),
            "low": torch.as_tensor(numbers.limits[:, :1, None]).to(dtype),
            "high": torch.as_tensor(numbers.limits[:, 1:, None]).to(dtype),
            "coupled": torch.as_tensor(network.preconditioner.reach(network.layout)[:, None, None]),
            "clamped": torch.as_tensor(_clamped_places(network)),
            "places": torch.as_tensor(numbers.places @ [network.stages, 1]),
            "input_scales": torch.as_tensor(_input_scales(network)).to(dtype),
            "pins": torch.as_tensor(_pins(network)),
            "entries": torch.as_tensor(numbers.entries),
            "shared": torch.as_tensor(numbers.shared),
        }
        roles = RoleRows.of(numbers.roles)._asdict()
        for name, table in (tables | roles).items():
            self.register_buffer(name, torch.as_tensor(table), persistent=False)

    @property
    def roles(self) -> RoleRows:
        """Rows of the neurons by role."""
        return RoleRows(self.duals, self.primal, self.positions, self.states)

    def read(
        self, weights: torch.Tensor, inputs: torch.Tensor, state: torch.Tensor
    ) -> tuple[list[torch.Tensor], torch.Tensor]:
        """Return `TorchTape.read`; replaced by a compiled version in `compile_blocks`."""
        return self._read(weights, inputs, state)

    def compile_blocks(self) -> None:
        """Fuse the blocks of a cell into a few loops with torch.compile."""
        self._read = torch.compile(self.tape.read, dynamic=True)

    def scaled(self, inputs: torch.Tensor) -> torch.Tensor:
        """Return inputs (I, N, B) in network units, from the user's values."""
        factor, offset = self.input_scales.unbind(1)
        return (inputs - offset[:, None, None]) / factor[:, None, None]

    def fill(self, x: torch.Tensor, inputs: torch.Tensor) -> torch.Tensor:
        """Return the state (P, N, B) of state vectors (B, n).

        Fixed neurons are at their inputs.
        """
        samples = x.shape[0]  # not len(x), which torch.export takes for a constant
        flat = x.new_zeros(self.live.numel(), samples).index_copy(0, self.places, x.T)
        if len(self.pins):
            place, row, stage = self.pins.unbind(1)
            values = inputs.expand(-1, -1, samples)[row, stage]
            flat = flat.index_copy(0, place, values)
        return self.spread(flat.reshape(*self.live.shape[:2], samples))

    def spread(self, rows: torch.Tensor) -> torch.Tensor:
        """Return rows (P, N, B) with shared neurons equal to the last cell's everywhere."""
        if not len(self.shared):
            return rows
        last = rows[self.shared, -1:].expand(-1, rows.shape[1], -1)
        return rows.index_copy(0, self.shared, last)

    def gathered(self, drives: torch.Tensor) -> torch.Tensor:
        """Return drives (P, N, B) with the sum for shared neurons in the last cell."""
        if not len(self.shared):
            return drives
        total = drives[self.shared].sum(1, keepdim=True).expand(-1, drives.shape[1], -1)
        return drives.index_copy(0, self.shared, total)

    def pack(self, state: torch.Tensor) -> torch.Tensor:
        """Return state vectors (B, n) of the live neurons, from a state (P, N, B)."""
        return state.flatten(0, 1)[self.places].T


def _preconditioner_layer(network: Network, dtype: torch.dtype) -> nn.Module:
    preconditioner = network.preconditioner
    if isinstance(preconditioner, Stiffness):
        is_clamped = len(clamped_rows(network)) > 0
        return EliminationLayer(preconditioner, network.layout, dtype=dtype, is_clamped=is_clamped)
    if isinstance(preconditioner, Multilevel):
        return PyramidLayer(evaluator(network).tape, network.stages, dtype=dtype)
    return TimeConstantsLayer()


def _clamped_places(network: Network) -> np.ndarray:
    places = network.places[np.isin(network.places[:, 0], clamped_rows(network))]
    return np.sort(places @ [network.stages, 1])


def _input_scales(network: Network) -> np.ndarray:
    scales = [network.input_scale(name) for name in network.cell.inputs]
    return np.array(scales, float).reshape(-1, 2)


def _pins(network: Network) -> np.ndarray:
    neurons, inputs = network.neuron_index, list(network.cell.inputs)
    rows = [
        (neurons[pin.neuron] * network.stages + pin.stage, inputs.index(pin.input), pin.stage)
        for pin in network.fixed
    ]
    return np.array(rows, np.int64).reshape(-1, 3)
