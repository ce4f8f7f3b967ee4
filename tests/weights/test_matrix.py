"""The matrix of weights: times the values of all nodes it is what arrives at neurons and sums."""

import csv
import io
from dataclasses import replace

import numpy as np
import pytest
from constrained import CONSTRAINED
from designs import coordinated, designed, near_start, small
from minimax import CASES, car

from ann_dc.evaluation.reference import evaluator
from ann_dc.network.cell import ONE, Cell, Connection, Limiter, Neuron, Sum, Template
from ann_dc.network.network import Network
from ann_dc.problem import plants
from ann_dc.solver import synthesize
from ann_dc.weights.matrix import to_csv, to_matrix

NETWORKS = {
    "car": lambda: small("car"),
    "pyramid": lambda: coordinated("two_link_arm"),
    "grid": lambda: designed("car").network,
    "inequalities": lambda: synthesize(CONSTRAINED["lander"].problem),
    "shared neurons": lambda: synthesize(car(CASES["two by range"][0])),
}


def node_at(network: Network, values: np.ndarray, name: str) -> float:
    """Value of a node by the name of its column; ``values`` (nodes, N + 2)."""
    if name == ONE:
        return 1.0
    head, _, rest = name.rpartition("[")
    stage, _, component = rest.partition("]")
    return values[network.node_index[head + component], int(stage) + 1]


def without_rails(network: Network) -> Network:
    """At a rail nothing counts that arrives."""
    neurons = tuple(replace(neuron, limiter=Limiter()) for neuron in network.cell.neurons)
    return replace(network, cell=replace(network.cell, neurons=neurons))


@pytest.mark.parametrize("name", NETWORKS)
def test_it_gives_what_arrives(name):
    network = without_rails(NETWORKS[name]())
    x = near_start(network, 3)
    values, matrix = evaluator(network).values(x), to_matrix(network)
    found = matrix.values @ [node_at(network, values, column) for column in matrix.columns]
    drives = network.pack(evaluator(network).drives(x))
    arriving = dict(zip(map(network.label, range(network.size)), drives))
    for row, value in zip(matrix.rows, found):
        expected = arriving.get(row)
        expected = node_at(network, values, row) if expected is None else expected
        assert value == pytest.approx(expected, rel=1e-12, abs=1e-12), row
    assert len(set(matrix.rows)) == len(matrix.rows) == matrix.values.shape[0]
    assert len(set(matrix.columns)) == len(matrix.columns) == matrix.values.shape[1]
    assert set(arriving) <= set(matrix.rows)


def test_as_a_table():
    network = small("double_integrator")
    matrix = to_matrix(network)
    (_, *columns), *rows = csv.reader(io.StringIO(to_csv(network)))
    assert tuple(columns) == matrix.columns
    assert tuple(row[0] for row in rows) == matrix.rows
    table = np.array([row[1:] for row in rows], float)
    np.testing.assert_array_equal(table, matrix.values.toarray())


def test_as_a_list():
    """A long row: one line a weight, each as it is."""
    network = synthesize(plants.double_integrator(N=90))
    matrix = to_matrix(network)
    head, *lines = csv.reader(io.StringIO(to_csv(network)))
    assert head == ["target", "source", "weight"]
    assert len(lines) == matrix.values.nnz
    dense = matrix.values.toarray()
    for target, source, weight in lines[::17]:
        found = dense[matrix.rows.index(target), matrix.columns.index(source)]
        assert found == float(weight)


def test_wires_beyond_neighbours_and_weights_of_each_stage():
    weight = np.array([2.0, 3.0, 5.0])
    cell = Cell(
        neurons=(Neuron(name="x"),),
        inputs=("d",),
        blocks=(Sum(name="s"),),
        connections=(
            Connection(source="x", target="s", template=-2, weight=weight),
            Connection(source=ONE, target="s", template=Template.SELF, weight=weight),
            Connection(source="d", target="x"),
        ),
    )
    matrix = to_matrix(Network(cell=cell, stages=3, inputs={"d": 1.0}, left_boundary={"x": "d"}))
    table = {
        (matrix.rows[r], matrix.columns[c]): float(matrix.values[r, c])
        for r, c in zip(*matrix.values.nonzero())
    }
    assert table == {
        **{(f"s[{k}]", "one"): w for k, w in enumerate(weight)},
        **{(f"x[{k}]", f"d[{k}]"): 1.0 for k in range(3)},
        ("s[2]", "x[0]"): 5.0,
        ("s[1]", "d[0]"): 3.0,
    }
