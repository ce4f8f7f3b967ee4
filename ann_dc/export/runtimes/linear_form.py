r"""Linear network as matrices from states and inputs to net inputs.

.. math:: d = A x + B u + b, \qquad \dot x = M d ,

with u the values of the inputs at all stages, in network units. Every node is represented by a row
of [A B b], so that fixed neurons, boundaries and shared neurons need no special rules.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy import sparse

from ann_dc.errors import ExportError
from ann_dc.network.cell import ONE, Function, Sum
from ann_dc.network.network import Network


class LinearForm(NamedTuple):
    """Matrices of d = A x + B u + b, with n components and I inputs at N stages."""

    states: sparse.csr_array
    """Matrix A (n, n)."""
    inputs: sparse.csr_array
    """Matrix B (n, I N), ordered by input, then by stage."""
    bias: np.ndarray
    """Vector b (n,)."""


def linear_form(network: Network) -> LinearForm:
    """Return the matrices of a network.

    Raises `ExportError`, which names the nodes, if the network is not linear.
    """
    _check_linear(network)
    return _Forms(network).drives()


def _check_linear(network: Network) -> None:
    cell = network.cell
    blocks = [
        f"{b.name} ({'function ' + b.function if isinstance(b, Function) else 'product'})"
        for b in cell.blocks
        if not isinstance(b, Sum)
    ]
    rails = [
        f"{n.name} (rails)"
        for n in cell.neurons
        if np.isfinite([n.limiter.low, n.limiter.high]).any()
    ]
    found = blocks + rails
    if found:
        told = ", ".join(found[:12]) + (f" and {len(found) - 12} more" if len(found) > 12 else "")
        raise ExportError(
            f"{network.title}: NIR has linear nodes only, not {told}; export a network without "
            "them, or to ONNX, C or Verilog-A"
        )


class _Forms:
    """Rows (N, n + I N + 1) of the nodes of a network, one per stage."""

    def __init__(self, network: Network) -> None:
        self.network, self.size = network, network.size
        self.width = network.size + len(network.cell.inputs) * network.stages + 1
        self.arriving: dict[str, list] = {}
        for wire in network.cell.connections:
            self.arriving.setdefault(wire.target, []).append(wire)
        cell, stages = network.cell, range(network.stages)
        self.nodes = {ONE: self._form([(k, self.width - 1) for k in stages])}
        for name in cell.inputs:
            self.nodes[name] = self._form([(k, self._column(name, k)) for k in stages])
        for name, row in network.neuron_index.items():
            own = network.state_index[row]
            self.nodes[name] = self._form([(k, int(own[k])) for k in stages if own[k] >= 0])
        for pin in network.fixed:
            held = self._form([(pin.stage, self._column(pin.input, pin.stage))])
            self.nodes[pin.neuron] = self.nodes[pin.neuron] + held
        for block in cell.blocks:
            self.nodes[block.name] = self._arriving(block.name)

    def _column(self, name: str, stage: int) -> int:
        place = self.network.cell.inputs.index(name)
        return self.size + place * self.network.stages + stage

    def _form(self, ones: list[tuple[int, int]]) -> sparse.csr_array:
        rows, columns = np.array(ones, np.int64).reshape(-1, 2).T
        shape = (self.network.stages, self.width)
        return sparse.csr_array((np.ones(len(ones)), (rows, columns)), shape=shape)

    def _shifted(self, name: str, offset: int) -> sparse.csr_array:
        """Return the rows of a node at a stage offset, with boundary inputs on the left."""
        stages = self.network.stages
        if offset == 0 or name == ONE:
            return self.nodes[name]
        shift = sparse.diags_array(np.ones(stages), offsets=offset, shape=(stages, stages))
        moved = sparse.csr_array(shift @ self.nodes[name])
        if -stages <= offset < 0 and name in self.network.left_boundary:
            moved = moved + self._form(
                [(-1 - offset, self._column(self.network.left_boundary[name], 0))]
            )
        return moved

    def _arriving(self, target: str) -> sparse.csr_array:
        total = self._form([])
        for wire in self.arriving.get(target, ()):
            weight = np.broadcast_to(np.asarray(wire.weight, float), self.network.stages)
            total = total + sparse.diags_array(weight) @ self._shifted(wire.source, wire.template)
        return sparse.csr_array(total)

    def drives(self) -> LinearForm:
        """Return the net inputs of the live neurons; a shared neuron sums over all cells."""
        network, shared = self.network, set(self.network.shared.tolist())
        arriving = [self._arriving(neuron.name) for neuron in network.cell.neurons]
        rows = [
            arriving[row].sum(axis=0)[None]
            if row in shared
            else arriving[row][[stage], :].toarray()
            for row, stage in network.places.tolist()
        ]
        table = sparse.csr_array(np.concatenate(rows) if rows else np.zeros((0, self.width)))
        n = self.size
        return LinearForm(table[:, :n], table[:, n:-1], table[:, [-1]].toarray().ravel())
