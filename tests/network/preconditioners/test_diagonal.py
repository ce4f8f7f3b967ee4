"""Time constants alone: the preconditioner that is there where nothing else is given."""

import numpy as np
from designs import small

from ann_dc.network.preconditioners.base import ArrayLayout, PreconditionerKind
from ann_dc.network.preconditioners.diagonal import Diagonal

ROW = ArrayLayout(
    rates=np.array([[0.5, 0.0], [2.0, 4.0]]), primal=np.array([0]), chains=np.zeros((0, 2), int)
)


def test_a_drive_moves_its_own_neuron():
    derivatives = Diagonal().apply(ROW, np.array([[2.0, 3.0], [1.0, 1.0]]))
    np.testing.assert_array_equal(derivatives, [[1.0, 0.0], [2.0, 4.0]])
    matrix = Diagonal().factors(ROW).matrix().toarray()
    np.testing.assert_array_equal(matrix, np.diag([0.5, 2.0, 4.0]))


def test_it_costs_no_wire():
    wires = Diagonal().wires(ROW)
    assert (wires.count, wires.nodes, wires.per_cell(2)) == (0, 0, 0.0)
    assert not Diagonal().reach(ROW).any()


def test_it_is_the_default():
    network = small("car")
    assert network.preconditioner.kind is PreconditionerKind.DIAGONAL
    network.preconditioner.check(network.layout)
    assert "diagonal" in str(network)


def test_the_state_vector_goes_by_stage():
    np.testing.assert_array_equal(ROW.component, [[0, -1], [1, 2]])
    np.testing.assert_array_equal(ROW.state_rates, [0.5, 2.0, 4.0])
    assert ROW.stages == 2
