r"""Sensitivity of the settled point to all weights and inputs, in one solve.

At a settled point F(x, w) = 0, so that

.. math:: \frac{dx^*}{dw} = -J^{-1} \frac{\partial F}{\partial w},
    \qquad J = \frac{\partial F}{\partial x} .

Only a few outputs y = L x are needed (the controls), while synapse weights are many. The adjoints
Lambda = -J^{-T} L^T are therefore solved once, with one right-hand side per output. One backward
sweep over the blocks gives dy/dw for all weights, and dy/dv for the values of all nodes, at all
stages.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse.linalg import splu

from ann_dc.errors import NetworkError
from ann_dc.evaluation.codegen.evaluator import FastEvaluator, fast_evaluator
from ann_dc.evaluation.reference import evaluator
from ann_dc.evaluation.tape import FUNCTION, PRODUCT, SUM, reading
from ann_dc.network.functions import FUNCTIONS
from ann_dc.network.network import Network
from ann_dc.validation import checked


@checked
def weight_sensitivity(
    network: Network, x: np.ndarray, outputs: np.ndarray
) -> dict[str, np.ndarray]:
    """Return the derivatives of some state components by all weights.

    `x` (n,) is an equilibrium, `outputs` (m,) are components of the state vector. The result maps
    connection names to (m, N) arrays. Raises `NetworkError` if the equilibrium is not isolated.

    Examples
    --------
    x = b / w, so that dx/dw = -b / w^2 and dx/db = 1 / w:

    >>> from ann_dc.network import Cell, Connection, Network, Neuron
    >>> wires = [Connection(source=s, target="x", weight=w) for s, w in (("x", -2.0), ("one", 1.0))]
    >>> row = Network(stages=1, cell=Cell(neurons=(Neuron(name="x"),), connections=tuple(wires)))
    >>> slopes = weight_sensitivity(row, np.array([0.5]), np.array([0]))
    >>> {name: slope.item() for name, slope in slopes.items()}
    {'x<-x': 0.25, 'x<-one': 0.5}
    """
    gradient, _ = _swept(network, x, outputs)
    return {name: gradient[:, edge] for name, edge in evaluator(network).edges.items()}


@checked
def input_sensitivity(
    network: Network, x: np.ndarray, outputs: np.ndarray
) -> dict[str, np.ndarray]:
    """Return the derivatives of some state components by all inputs.

    `x` (n,) is an equilibrium, `outputs` (m,) are components of the state vector. The result maps
    input names to (m, N) arrays; states and inputs are in network units. Raises `NetworkError` if
    the equilibrium is not isolated.

    Examples
    --------
    x = p / 2:

    >>> from ann_dc.network import Cell, Connection, Network, Neuron
    >>> wires = [Connection(source=s, target="x", weight=w) for s, w in (("x", -2.0), ("p", 1.0))]
    >>> cell = Cell(neurons=(Neuron(name="x"),), inputs=("p",), connections=tuple(wires))
    >>> row = Network(stages=1, cell=cell, inputs={"p": 1.0})
    >>> input_sensitivity(row, np.array([0.5]), np.array([0]))["p"].item()
    0.5
    """
    _, nodes = _swept(network, x, outputs)
    rows = network.node_index
    slopes = {name: nodes[:, rows[name], 1:-1].copy() for name in network.cell.inputs}
    for pin in network.fixed:
        slopes[pin.input][:, pin.stage] += nodes[:, rows[pin.neuron], pin.stage + 1]
    for node, name in network.left_boundary.items():
        slopes[name][:, 0] += nodes[:, rows[node], 0]
    return slopes


def _swept(network: Network, x: np.ndarray, outputs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return derivatives by weights (m, edges, N) and node values (m, nodes, N + 2)."""
    compiled, tape = fast_evaluator(network), evaluator(network).tape
    adjoints = _Adjoints(network, compiled.values(x), _solved(compiled, x, outputs))
    gradient = np.zeros((len(outputs), *tape.weights.shape))
    for neuron, (first, last) in enumerate(tape.drives):
        adjoints.through_edges(gradient, adjoints.drives[:, neuron], first, last)
    for order in range(len(tape.blocks) - 1, -1, -1):
        adjoints.through_block(gradient, order)
    return gradient, adjoints.nodes


def _solved(compiled: FastEvaluator, x: np.ndarray, outputs: np.ndarray) -> np.ndarray:
    """Return -J^{-T} L^T (m, n) among the free neurons; saturated ones do not move."""
    wanted = np.zeros((compiled.network.size, len(outputs)))
    wanted[np.asarray(outputs), np.arange(len(outputs))] = 1.0
    free, solved = np.flatnonzero(compiled.free(x)), np.zeros(wanted.T.shape)
    try:
        factors = splu(compiled.drive_jacobian(x).tocsc()[free][:, free])
    except RuntimeError as error:
        raise NetworkError(
            "sensitivity: the Jacobian is singular; the equilibrium is not isolated"
        ) from error
    solved[:, free] = -factors.solve(wanted[free], trans="T").T
    return solved


class _Adjoints:
    """Derivatives of the outputs by every node, (m, nodes, N + 2)."""

    def __init__(self, network: Network, values: np.ndarray, solved: np.ndarray) -> None:
        self.network, self.tape, self.values = network, evaluator(network).tape, values
        self.nodes = np.zeros((len(solved), *values.shape))
        self.drives = np.zeros((len(solved), *network.live.shape))
        self.drives[:, network.places[:, 0], network.places[:, 1]] = solved
        self.drives[:, network.shared] = self.drives[:, network.shared, -1:]  # all send to one

    def through_edges(self, gradient: np.ndarray, of_target, first: int, last: int) -> None:
        """Propagate derivatives from a sum or a neuron to its weights and sources."""
        stages = self.network.stages
        for edge in range(first, last):
            source, offset = self.tape.sources[edge]
            here, there = reading(offset, stages)
            gradient[:, edge, here] = of_target[:, here] * self.values[source, there]
            self.nodes[:, source, there] += of_target[:, here] * self.tape.weights[edge, here]

    def through_block(self, gradient: np.ndarray, order: int) -> None:
        """Propagate derivatives from a block to its inputs."""
        kind, node, a, b = self.tape.blocks[order]
        of_block = self.nodes[:, node, 1:-1]
        if kind == SUM:
            self.through_edges(gradient, of_block.copy(), a, b)
        elif kind == PRODUCT:
            self.nodes[:, a, 1:-1] += of_block * self.values[b, 1:-1]
            self.nodes[:, b, 1:-1] += of_block * self.values[a, 1:-1]
        elif kind == FUNCTION:
            slope = FUNCTIONS[a].slope(self.values[b, 1:-1], self.values[node, 1:-1])
            self.nodes[:, b, 1:-1] += of_block * slope
