r"""How the settled point moves with every synapse weight and every input, in one solve.

At a settled point F(x, w) = 0, so that

.. math:: \frac{dx^*}{dw} = -J^{-1} \frac{\partial F}{\partial w},
    \qquad J = \frac{\partial F}{\partial x} .

Only a few outputs y = L x matter (the controls), and weights are many: the adjoints
Lambda = -J^{-T} L^T are solved for once, one right-hand side an output, and one backward sweep over
the blocks gives dy/dw for all weights, and dy/dv for the values of all nodes, at all stages.
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
from ann_dc.validation.checked import checked


@checked
def weight_sensitivity(
    network: Network, x: np.ndarray, outputs: np.ndarray
) -> dict[str, np.ndarray]:
    """Derivatives of some state components by all weights, at an equilibrium.

    Parameters
    ----------
    network : Network
    x : (n,) array
        An equilibrium.
    outputs : (m,) array of int
        Components of the state vector.

    Returns
    -------
    dict of connection name to (m, N) array

    Raises
    ------
    NetworkError
        If the equilibrium is not isolated.

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
    """Derivatives of some state components by all inputs, at an equilibrium.

    Parameters
    ----------
    network : Network
    x : (n,) array
        An equilibrium.
    outputs : (m,) array of int
        Components of the state vector.

    Returns
    -------
    dict of input name to (m, N) array
        Both in network units.

    Raises
    ------
    NetworkError
        If the equilibrium is not isolated.

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
    for pin in network.pins:
        slopes[pin.input][:, pin.stage] += nodes[:, rows[pin.neuron], pin.stage + 1]
    for node, name in network.left.items():
        slopes[name][:, 0] += nodes[:, rows[node], 0]
    return slopes


def _swept(network: Network, x: np.ndarray, outputs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Derivatives by all weights (m, edges, N), and by the values of nodes (m, nodes, N + 2)."""
    compiled, tape = fast_evaluator(network), evaluator(network).tape
    adjoints = _Adjoints(network, compiled.values(x), _solved(compiled, x, outputs))
    gradient = np.zeros((len(outputs), *tape.weights.shape))
    for neuron, (first, last) in enumerate(tape.drives):
        adjoints.through_edges(gradient, adjoints.drives[:, neuron], first, last)
    for order in range(len(tape.blocks) - 1, -1, -1):
        adjoints.through_block(gradient, order)
    return gradient, adjoints.nodes


def _solved(compiled: FastEvaluator, x: np.ndarray, outputs: np.ndarray) -> np.ndarray:
    """-J^{-T} L^T as (m, n) among the free neurons; those at rails stay there."""
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
        """From a sum or a neuron to its weights and its sources."""
        stages = self.network.stages
        for edge in range(first, last):
            source, offset = self.tape.sources[edge]
            here, there = reading(offset, stages)
            gradient[:, edge, here] = of_target[:, here] * self.values[source, there]
            self.nodes[:, source, there] += of_target[:, here] * self.tape.weights[edge, here]

    def through_block(self, gradient: np.ndarray, order: int) -> None:
        """From a block to its inputs."""
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
