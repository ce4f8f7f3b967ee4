"""The compiled integrator: closed forms, SciPy's method with the same coefficients, its ends."""

import numpy as np
import pytest
from designs import designed
from hypothesis import given, settings, strategies as st
from scipy import integrate

from ann_dc.backends import COMPILED, DOP853, OdeBackend, Outcome
from ann_dc.backends.integration import DOP853_TABLEAU, Course, Ends, Log, advance, begin
from ann_dc.evaluation import CompiledEvaluator
from ann_dc.network import Cell, Connection, Function, Limiter, Network, Neuron

QUICK = OdeBackend(verify=False)


def ring(damping: float = 0.0) -> Network:
    """x' = y - d x, y' = -x - d y: turns with one radian a unit of time."""
    cell = Cell(
        neurons=(Neuron(name="x"), Neuron(name="y")),
        connections=(
            Connection(source="y", target="x", weight=1.0),
            Connection(source="x", target="y", weight=-1.0),
            Connection(source="x", target="x", weight=-damping),
            Connection(source="y", target="y", weight=-damping),
        ),
    )
    return Network(cell=cell, stages=1, start={"x": 1.0})


def integrated(network: Network, pieces=(10_000,), **changed):
    """(times, states, how it ended) of one integration, in so many pieces."""
    evaluator, start = CompiledEvaluator(network), network.start_state
    settings = {"until": 10.0, "settled": 0.0, "largest": 1e9, "rtol": 1e-6, "atol": 1e-12}
    ends = Ends(**(settings | {"guard": evaluator.domain_guard(start)} | changed))
    course = Course.at(start, DOP853_TABLEAU, 0.1)
    begin(evaluator.tape, evaluator.work, course)
    times, states, ended = [], [], None
    for steps in pieces:
        log = Log.of(steps, len(start))
        count, ended = advance(evaluator.tape, evaluator.work, DOP853_TABLEAU, course, ends, log)
        times.append(log.times[:count])
        states.append(log.states[:count])
    return np.concatenate(times), np.concatenate(states), ended


def exact(times: np.ndarray, damping: float) -> np.ndarray:
    turned = np.exp(-damping * times) * np.array([np.cos(times), -np.sin(times)])
    return turned.T


@settings(max_examples=20)
@given(st.floats(0.0, 2.0), st.floats(-10.0, -4.0))
def test_a_rotation_that_decays(damping, decades):
    rtol = 10.0**decades
    times, states, _ = integrated(ring(damping), rtol=rtol, atol=1e-3 * rtol)
    assert times[-1] == 10.0
    np.testing.assert_allclose(states, exact(times, damping), atol=30 * rtol)


def test_it_is_of_order_eight():
    """Steps of one length, since no tolerance is asked for: a quarter of it, 4^8 the error."""
    errors = []
    for pieces in (8, 16):
        evaluator = CompiledEvaluator(ring())
        course = Course.at(evaluator.network.start_state, DOP853_TABLEAU, 8.0 / pieces)
        begin(evaluator.tape, evaluator.work, course)
        guard = evaluator.domain_guard(course.x)
        for step in range(pieces):
            course.clock[1] = 8.0 / pieces
            ends = Ends(8.0 / pieces * (step + 1), 0.0, 1e9, guard, 1.0, 1e9)
            advance(evaluator.tape, evaluator.work, DOP853_TABLEAU, course, ends, Log.of(1, 2))
        errors.append(np.abs(course.x - exact(np.array([8.0]), 0.0)[0]).max())
    assert np.log2(errors[0] / errors[1]) == pytest.approx(8, abs=0.7)


def test_the_steps_are_those_of_scipys_method():
    """With the same first step and tolerances that do not shrink."""
    network = ring(0.3)
    rhs = CompiledEvaluator(network).rhs
    solver = integrate.DOP853(
        lambda _, x: rhs(x), 0.0, network.start_state, 10.0, rtol=1e-6, atol=1e-12, first_step=0.1
    )
    expected = []
    while solver.status == "running":
        solver.step()
        expected.append(solver.t)
    times, states, _ = integrated(network, settled=-1.0)
    np.testing.assert_allclose(times, expected, rtol=1e-5)  # the estimates are near rounding
    np.testing.assert_allclose(states[-1], solver.y, rtol=1e-9)


def test_in_pieces_it_has_the_same_bits():
    whole = integrated(ring(0.1))
    parts = integrated(ring(0.1), pieces=(1, 2, 5, 10_000))
    np.testing.assert_array_equal(parts[0], whole[0])
    np.testing.assert_array_equal(parts[1], whole[1])


@pytest.mark.parametrize("name", ["car", "double_integrator", "unicycle"])
def test_a_network_settles_as_with_scipy(name):
    network = designed(name).network
    ours, theirs = (OdeBackend(method=m, verify=False).run(network) for m in (COMPILED, DOP853))
    assert ours.status.outcome is Outcome.SETTLED
    np.testing.assert_allclose(ours.settling_time, theirs.settling_time, rtol=1e-3)
    assert ours.evaluations < 1.2 * theirs.evaluations
    scale = np.abs(theirs.trajectory.final).max()
    np.testing.assert_allclose(ours.trajectory.final, theirs.trajectory.final, atol=1e-7 * scale)


def test_what_overflows_has_diverged():
    cell = Cell(
        neurons=(Neuron(name="x"),),
        connections=(Connection(source="x", target="x", weight=1.0),),
    )
    run = QUICK.run(Network(cell=cell, stages=2, start={"x": 1.0}))
    assert run.status.outcome is Outcome.DIVERGED
    assert run.status.neuron == "x[0]"


def test_what_leaves_a_domain_is_told():
    cell = Cell(
        neurons=(Neuron(name="x"),),
        blocks=(Function(name="g", function="sqrt", x="x"),),
        connections=(
            Connection(source="g", target="x", weight=-1.0),
            Connection(source="one", target="x", weight=-1.0),
        ),
    )
    run = QUICK.run(Network(cell=cell, stages=1, start={"x": 1.0}))
    assert run.status.outcome is Outcome.LEFT_DOMAIN
    assert run.status.neuron == "g [0]"
    assert run.status.time == pytest.approx(2 * (1 - np.log(2)), rel=1e-9)  # where x is zero


def test_a_neuron_rests_at_its_rail():
    cell = Cell(
        neurons=(Neuron(name="x", limiter=Limiter(low=-1.0, high=0.5)),),
        connections=(Connection(source="one", target="x", weight=1.0),),
    )
    times, states, _ = integrated(Network(cell=cell, stages=1), until=3.0)
    assert times[-1] == 3.0
    np.testing.assert_allclose(states[-1], 0.5, atol=0.05)
