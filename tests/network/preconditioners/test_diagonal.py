"""Time constants alone: the metric that is there where nothing else is given."""

import numpy as np
from designs import small

from ann_dc.network.preconditioners.base import Kind, Row
from ann_dc.network.preconditioners.diagonal import TimeConstants

ROW = Row(
    rates=np.array([[0.5, 0.0], [2.0, 4.0]]), primal=np.array([0]), chains=np.zeros((0, 2), int)
)


def test_a_drive_moves_its_own_neuron():
    moves = TimeConstants().apply(ROW, np.array([[2.0, 3.0], [1.0, 1.0]]))
    np.testing.assert_array_equal(moves, [[1.0, 0.0], [2.0, 4.0]])
    matrix = TimeConstants().factors(ROW).matrix().toarray()
    np.testing.assert_array_equal(matrix, np.diag([0.5, 2.0, 4.0]))


def test_it_costs_no_wire():
    wires = TimeConstants().wires(ROW)
    assert (wires.count, wires.nodes, wires.per_cell(2)) == (0, 0, 0.0)
    assert not TimeConstants().reach(ROW).any()


def test_it_is_the_default():
    network = small("car")
    assert network.metric.kind is Kind.TIME_CONSTANTS
    network.metric.check(network.row)
    assert "time constants alone" in str(network)


def test_the_state_vector_goes_by_stage():
    np.testing.assert_array_equal(ROW.component, [[0, -1], [1, 2]])
    np.testing.assert_array_equal(ROW.state_rates, [0.5, 2.0, 4.0])
    assert ROW.stages == 2
