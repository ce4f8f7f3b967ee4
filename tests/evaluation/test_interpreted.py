"""Evaluators on a CPU: the preconditioner, a recurrence, inputs in place,
rates.
"""

import numpy as np
import pytest
from designs import coordinated, near_start, small

from ann_dc.evaluation.codegen.evaluator import FastEvaluator, GeneratedEvaluator
from ann_dc.evaluation.domains import Bounds
from ann_dc.evaluation.interpreted import InterpretedEvaluator
from ann_dc.evaluation.reference import evaluator
from ann_dc.evaluation.rules import LOST, RAN, SETTLED
from ann_dc.network.cell import Cell, Connection, Function, Neuron
from ann_dc.network.network import Network


@pytest.fixture(params=[InterpretedEvaluator, GeneratedEvaluator], ids=lambda kind: kind.__name__)
def kind(request) -> type:
    return request.param


@pytest.mark.parametrize("wired", [small, coordinated])
def test_the_preconditioner_is_the_reference(kind, wired):
    network = wired("car")
    v = near_start(network, 5)
    expected = evaluator(network).preconditioner @ v
    np.testing.assert_allclose(kind(network).derivative(v), expected, rtol=1e-12)


def test_inputs_may_change():
    wires = (Connection(source="drive", target="x"),)
    cell = Cell(neurons=(Neuron(name="x"),), inputs=("drive",), connections=wires)
    ours = InterpretedEvaluator(Network(cell=cell, stages=3, inputs={"drive": 1.0}))
    np.testing.assert_array_equal(ours.rhs(np.zeros(3)), [1.0, 1.0, 1.0])
    ours.set_inputs(np.array([ours.node_index["drive"]]), np.array([[2.0, 3.0, 4.0]]))
    np.testing.assert_array_equal(ours.rhs(np.zeros(3)), [2.0, 3.0, 4.0])


def leak(rate: float = -1.0) -> Network:
    wires = (Connection(source="x", target="x", weight=rate),)
    return Network(cell=Cell(neurons=(Neuron(name="x"),), connections=wires), stages=2)


def free(ours: FastEvaluator, x: np.ndarray, slew=np.inf, low=-np.inf) -> Bounds:
    n = len(x)
    box = np.column_stack([np.full(n, low), np.full(n, np.inf)])
    return Bounds(slew=np.full(n, slew), box=box, guard=ours.domain_guard(x))


def recurred(kind: type, network: Network, x, count=10, tolerance=1e-12, **bounds):
    ours, state = kind(network), np.array(x, float)
    outcome = ours.recur(state, 0.5, free(ours, state, **bounds), count=count, tolerance=tolerance)
    return state, *outcome


def test_a_recurrence_is_forward_euler(kind):
    x, done, last, outcome = recurred(kind, leak(), [1.0, 2.0], count=3)
    np.testing.assert_array_equal(x, np.array([1.0, 2.0]) / 8)
    assert (done, last, outcome) == (3, 0.5, RAN)


def test_a_recurrence_ends_where_it_settles(kind):
    x, done, last, outcome = recurred(kind, leak(), [1.0, 1.0], count=100, tolerance=1e-3)
    assert outcome == SETTLED
    assert last < 1e-3
    assert done == 10
    np.testing.assert_array_equal(x, np.full(2, 0.5**10))


def test_the_fastest_neuron_shortens_the_step_of_all(kind):
    x, *_ = recurred(kind, leak(), [1.0, 2.0], count=1, slew=0.1)
    np.testing.assert_allclose(x, [1.0 - 0.05, 2.0 - 0.1])


def test_the_state_stays_in_its_box(kind):
    x, *_ = recurred(kind, leak(), [1.0, 2.0], count=20, tolerance=0.0, low=0.25)
    np.testing.assert_array_equal(x, [0.25, 0.25])


def test_what_overflows_is_lost(kind):
    *_, outcome = recurred(kind, leak(1e60), [1.0, 2.0])
    assert outcome == LOST


def test_what_leaves_a_domain_is_lost(kind):
    cell = Cell(
        neurons=(Neuron(name="x"),),
        blocks=(Function(name="g", function="reciprocal", x="x"),),
        connections=(Connection(source="g", target="x", weight=-1.0),),
    )
    x, done, _, outcome = recurred(kind, Network(cell=cell, stages=1), [0.5])
    assert (done, outcome) == (1, LOST)
    assert x == -0.5


def test_the_fastest_rate(kind):
    assert kind(leak(-7.0)).fastest_rate(np.ones(2)) == pytest.approx(7.0)
