"""The compiled integrator: closed forms, SciPy's method with the same coefficients, its ends."""

import numpy as np
import pytest
from designs import designed
from hypothesis import given, settings, strategies as st
from scipy import integrate

from ann_dc.backends.integration.integrator import Course, Ends, Log, advance, draw
from ann_dc.backends.integration.systems import Cells, Integrand, generated, interpreted
from ann_dc.backends.integration.tableaus import DOP853_TABLEAU, TSIT5_TABLEAU, Rows
from ann_dc.backends.ode import COMPILED, DOP853, OdeBackend
from ann_dc.backends.status import Outcome
from ann_dc.evaluation.codegen.lanes import Lanes
from ann_dc.evaluation.codegen.plan import Axis
from ann_dc.evaluation.interpreted import InterpretedEvaluator
from ann_dc.network.cell import Cell, Connection, Function, Limiter, Neuron
from ann_dc.network.network import Network

of_every_kind = pytest.mark.parametrize("kind", ["interpreted", "generated"])
every_cell = pytest.mark.parametrize("cells", [Cells.INTERPRETED, Cells.GENERATED], ids=str)


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


def integrand_of(network: Network, kind: str) -> Integrand:
    """A network as loops interpret it, or as generated code."""
    compiled = InterpretedEvaluator(network)
    guard = compiled.domain_guard(network.start_state)
    if kind == "interpreted":
        return interpreted(compiled, guard)
    return generated(Lanes(compiled.tape, Axis.STAGES), guard)


def integrated(network: Network, kind: str, pieces=(10_000,), tableau=DOP853_TABLEAU, **changed):
    """(times, states, how it ended) of one integration, in so many pieces."""
    integrand, rows = integrand_of(network, kind), Rows.of(tableau)
    system, size = integrand.system, integrand.system.size
    settings = {"until": 10.0, "settled": 0.0, "largest": 1e9, "rtol": 1e-6, "atol": 1e-12}
    course = Course.at(integrand.state(network.start_state), integrand.length, rows, 0.1)
    times, states, ended = [], [], None
    for steps in pieces:
        log = Log.of(steps, size)
        count, ended = advance(system, rows, course, Ends(**(settings | changed)), log)
        times.append(log.times[:count])
        states.append(log.states[:count, integrand.chosen])
    return np.concatenate(times), np.concatenate(states), ended


def exact(times: np.ndarray, damping: float) -> np.ndarray:
    turned = np.exp(-damping * times) * np.array([np.cos(times), -np.sin(times)])
    return turned.T


@of_every_kind
@pytest.mark.parametrize("tableau", [DOP853_TABLEAU, TSIT5_TABLEAU], ids=["DOP853", "Tsit5"])
@settings(max_examples=10)
@given(st.floats(0.0, 2.0), st.floats(-10.0, -4.0))
def test_a_rotation_that_decays(kind, tableau, damping, decades):
    rtol = 10.0**decades
    changed = {"rtol": rtol, "atol": 1e-3 * rtol}
    times, states, _ = integrated(ring(damping), kind, tableau=tableau, **changed)
    assert times[-1] == 10.0
    np.testing.assert_allclose(states, exact(times, damping), atol=30 * rtol)


@of_every_kind
@pytest.mark.parametrize(
    ("tableau", "order", "first"), [(DOP853_TABLEAU, 8, 8), (TSIT5_TABLEAU, 5, 32)]
)
def test_its_order(kind, tableau, order, first):
    """Steps of one length, since no tolerance is asked for: half of it, 2^order less error."""
    errors, rows = [], Rows.of(tableau)
    for pieces in (first, 2 * first):
        network = ring()
        integrand = integrand_of(network, kind)
        system, h = integrand.system, 8.0 / pieces
        course = Course.at(integrand.state(network.start_state), integrand.length, rows, h)
        for step in range(pieces):
            course.clock[1] = h
            ends = Ends(h * (step + 1), 0.0, 1e9, 1.0, 1e9)
            advance(system, rows, course, ends, Log.of(1, system.size))
        x = course.x[system.ghost :][integrand.chosen]
        errors.append(np.abs(x - exact(np.array([8.0]), 0.0)[0]).max())
    assert np.log2(errors[0] / errors[1]) == pytest.approx(order, abs=0.7)


@of_every_kind
@pytest.mark.parametrize(
    ("tableau", "order", "first"), [(DOP853_TABLEAU, 7, 8), (TSIT5_TABLEAU, 4, 32)]
)
def test_states_inside_steps_have_the_order_of_the_extension(kind, tableau, order, first):
    """Steps of one length from exact states: half of it, 2^(order + 1) less error."""
    errors, theta = [], np.linspace(0.05, 0.95, 7)
    for pieces in (first, 2 * first):
        integrand, rows, network = integrand_of(ring(), kind), Rows.of(tableau), ring()
        known = np.linspace(0.0, 8.0, pieces + 1)
        times = np.sort((known[:-1, None] + 8.0 / pieces * theta).ravel())
        course = Course.at(integrand.state(network.start_state), integrand.length, rows, 0.1)
        places, ends = integrand.system.ghost + integrand.chosen, Ends(0.0, 0.0, 1e9, 1.0, 1e9)
        states = exact(known, 0.0)
        found = draw(integrand.system, rows, course, ends, places, (known, states), times)
        errors.append(np.abs(found - exact(times, 0.0)).max())
    assert np.log2(errors[0] / errors[1]) == pytest.approx(order + 1, abs=0.7)


@of_every_kind
def test_gap_of_many_steps_is_bridged_by_the_steps_it_takes(kind):
    network, rows = ring(), Rows.of(DOP853_TABLEAU)
    integrand, times = integrand_of(network, kind), np.linspace(0.0, 40.0, 97)
    course = Course.at(integrand.state(network.start_state), integrand.length, rows, 0.1)
    places, ends = integrand.system.ghost + integrand.chosen, Ends(0.0, 0.0, 1e9, 1e-6, 1e-9)
    known = np.array([0.0, 40.0])
    gap = known, exact(known, 0.0)
    found = draw(integrand.system, rows, course, ends, places, gap, times)
    np.testing.assert_allclose(found, exact(times, 0.0), atol=1e-5)


@of_every_kind
def test_the_steps_are_those_of_scipys_method(kind):
    """With the same first step and tolerances that do not shrink."""
    network = ring(0.3)
    rhs = InterpretedEvaluator(network).rhs
    solver = integrate.DOP853(
        lambda _, x: rhs(x), 0.0, network.start_state, 10.0, rtol=1e-6, atol=1e-12, first_step=0.1
    )
    expected = []
    while solver.status == "running":
        solver.step()
        expected.append(solver.t)
    times, states, _ = integrated(network, kind, settled=-1.0)
    np.testing.assert_allclose(times, expected, rtol=1e-5)  # the estimates are near rounding
    np.testing.assert_allclose(states[-1], solver.y, rtol=1e-9)


@of_every_kind
def test_in_pieces_it_has_the_same_bits(kind):
    whole = integrated(ring(0.1), kind)
    parts = integrated(ring(0.1), kind, pieces=(1, 2, 5, 10_000))
    np.testing.assert_array_equal(parts[0], whole[0])
    np.testing.assert_array_equal(parts[1], whole[1])


@every_cell
@pytest.mark.parametrize("name", ["car", "double_integrator", "unicycle"])
def test_a_network_settles_as_with_scipy(name, cells):
    network = designed(name).network
    ours = OdeBackend(method=COMPILED, cells=cells, verify=False).run(network)
    theirs = OdeBackend(method=DOP853, verify=False).run(network)
    assert ours.status.outcome is Outcome.SETTLED
    np.testing.assert_allclose(ours.settling_time, theirs.settling_time, rtol=1e-3)
    assert ours.evaluations < 1.2 * theirs.evaluations
    scale = np.abs(theirs.trajectory.final).max()
    np.testing.assert_allclose(ours.trajectory.final, theirs.trajectory.final, atol=1e-7 * scale)


@every_cell
def test_what_overflows_has_diverged(cells):
    cell = Cell(
        neurons=(Neuron(name="x"),),
        connections=(Connection(source="x", target="x", weight=1.0),),
    )
    run = OdeBackend(cells=cells, verify=False).run(Network(cell=cell, stages=2, start={"x": 1.0}))
    assert run.status.outcome is Outcome.DIVERGED
    assert run.status.neuron == "x[0]"


@every_cell
def test_what_leaves_a_domain_is_told(cells):
    cell = Cell(
        neurons=(Neuron(name="x"),),
        blocks=(Function(name="g", function="sqrt", x="x"),),
        connections=(
            Connection(source="g", target="x", weight=-1.0),
            Connection(source="one", target="x", weight=-1.0),
        ),
    )
    run = OdeBackend(cells=cells, verify=False).run(Network(cell=cell, stages=1, start={"x": 1.0}))
    assert run.status.outcome is Outcome.LEFT_DOMAIN
    assert run.status.neuron == "g [0]"
    assert run.status.time == pytest.approx(2 * (1 - np.log(2)), rel=1e-9)  # where x is zero


@of_every_kind
def test_a_neuron_rests_at_its_rail(kind):
    cell = Cell(
        neurons=(Neuron(name="x", limiter=Limiter(low=-1.0, high=0.5)),),
        connections=(Connection(source="one", target="x", weight=1.0),),
    )
    times, states, _ = integrated(Network(cell=cell, stages=1), kind, until=3.0)
    assert times[-1] == 3.0
    np.testing.assert_allclose(states[-1], 0.5, atol=0.05)
