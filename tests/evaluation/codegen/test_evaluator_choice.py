"""Which evaluator a network gets, and that another tape's numbers are taken over as they are."""

import numpy as np
import pytest
from designs import coordinated, near_start, small

from ann_dc.evaluation.codegen.evaluator import FastEvaluator, GeneratedEvaluator, fast_evaluator
from ann_dc.evaluation.domains import Bounds
from ann_dc.evaluation.interpreted import InterpretedEvaluator
from ann_dc.evaluation.reference import evaluator, tape_with_penalty
from ann_dc.network.cell import Cell, Connection, Neuron
from ann_dc.network.network import Network

WIRED = pytest.mark.parametrize("wired", [small, coordinated])


def reported(ours: FastEvaluator, x: np.ndarray) -> list:
    return [ours.rhs(x), ours.derivative(x), ours.jacobian_entries(x), ours.residuals(x)]


def same(found: list, expected: list) -> None:
    for a, b in zip(found, expected):
        np.testing.assert_allclose(a, b, rtol=1e-11, atol=1e-11)


def test_a_wire_beyond_neighbours_is_generated():
    far = Connection(source="x", target="x", template=2)
    network = Network(cell=Cell(neurons=(Neuron(name="x"),), connections=(far,)), stages=4)
    assert isinstance(fast_evaluator(network), GeneratedEvaluator)


@WIRED
@pytest.mark.parametrize("rho", [0.3, 1.0])
def test_derivatives_of_a_large_cell_are_those_of_loops(monkeypatch, wired, rho):
    network = wired("unicycle")
    x, tape = near_start(network, 1), tape_with_penalty(network, rho)
    ours = GeneratedEvaluator(network, tape_with_penalty(network, 7.0))
    code = ours.jacobian_entries(x)
    monkeypatch.setattr("ann_dc.evaluation.codegen.evaluator.LONGEST_JACOBIAN", 10)
    monkeypatch.setattr(ours, "_call", None)
    np.testing.assert_allclose(ours.jacobian_entries(x), code, rtol=1e-11, atol=1e-11)
    ours.renumber(tape)
    expected = InterpretedEvaluator(network, tape).jacobian_entries(x)
    np.testing.assert_allclose(ours.jacobian_entries(x), expected, rtol=1e-11, atol=1e-11)


@WIRED
def test_plants_are_generated(wired):
    assert isinstance(fast_evaluator(wired("car")), GeneratedEvaluator)


@WIRED
@pytest.mark.parametrize("rho", [0.0, 0.3, 1.0])
def test_other_numbers_are_those_of_a_fresh_evaluator(wired, rho):
    """A penalty of one is another code: a weight of one is none."""
    network = wired("unicycle")
    x, first = near_start(network, 1), tape_with_penalty(network, 7.0)
    ours, other = fast_evaluator(network, first), tape_with_penalty(network, rho)
    slower = other._replace(rates=other.rates / 3)
    for tape in (other, slower, first):
        ours.renumber(tape)
        same(reported(ours, x), reported(InterpretedEvaluator(network, tape), x))


@WIRED
def test_a_trial_leaves_the_networks_own_numbers_alone(wired):
    network = wired("unicycle")
    x, own = near_start(network, 1), fast_evaluator(network)
    before = reported(own, x)
    trial = fast_evaluator(network)
    trial.renumber(tape_with_penalty(network, 0.5))
    same(reported(own, x), before)
    assert not np.allclose(trial.rhs(x), own.rhs(x))


@WIRED
def test_recurrences_agree(wired):
    network = wired("car")
    start = near_start(network, 3)
    free = np.full(len(start), np.inf)
    step = 0.5 / evaluator(network).fastest_rate(start)
    ends = []
    for kind in (InterpretedEvaluator, GeneratedEvaluator):
        ours, x = kind(network), start.copy()
        bounds = Bounds(
            slew=np.full(len(x), 0.01),
            box=np.column_stack([-free, free]),
            guard=ours.domain_guard(x),
        )
        ends.append((x, *ours.recur(x, step, bounds, count=50, tolerance=0.0)))
    np.testing.assert_allclose(ends[0][0], ends[1][0], rtol=1e-9, atol=1e-9)
    assert ends[0][1] == ends[1][1] == 50
    assert ends[0][2] == pytest.approx(ends[1][2], rel=1e-8)
