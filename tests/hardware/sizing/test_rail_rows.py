"""Rails of coupled neurons as rows: they press as the projection does, as fast as they are to."""

from functools import cache

import numpy as np
import pytest
from constrained import a, dint_u, integrator, lander

from ann_dc import OdeBackend, PreconditionerKind, SpiceBackend, design, levels, ode
from ann_dc.analysis.spectra import spectrum
from ann_dc.backends.spice.probe import probed
from ann_dc.errors import NetworkError
from ann_dc.hardware.circuit.scaling import ProbeRun, ScalingRules, scale
from ann_dc.hardware.schematic.elements import Integrator, PICell
from ann_dc.hardware.sizing.bandwidth_margin import FOLLOWING, following_margin
from ann_dc.hardware.sizing.rail_rows import BANDWIDTH, FASTER, GAIN, INTO, SLOWER, with_rail_rows
from ann_dc.network.cell import Cell, Connection, Limiter, Neuron, Role
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.resistive_grid import ResistiveGrid
from ann_dc.progress import silent

RATE, PUSH, RAIL = 3.0, 2.0, 0.5
PROBE = OdeBackend(method=ode.DOP853, verify=False)


def pushed(*, start: float = 0.0, low: float = -np.inf) -> Network:
    """z' = M (push - z) with a rail at 1/2, in two cells that a grid couples."""
    limiter = Limiter(low=low, high=RAIL)
    ends = (("one", PUSH), ("x", -1.0))
    return Network(
        stages=2,
        cell=Cell(
            neurons=(Neuron(name="x", role=Role.PRIMAL, limiter=limiter),),
            connections=tuple(Connection(source=s, target="x", weight=w) for s, w in ends),
        ),
        preconditioner=ResistiveGrid(
            own=np.full((2, 1, 1), 1.0), following=np.full((1, 1, 1), -0.5)
        ),
        start={"x": start},
    )


def with_rows(network: Network) -> Network:
    states = np.array([network.start_state, np.full(2, RAIL)])
    probe = ProbeRun(states=states, times=np.arange(2.0), radius=1.0)
    return with_rail_rows(network, scale(network, probe), RATE)


def test_rows_settle_at_the_rail_with_the_current_of_the_projection():
    """M^-1 z' - d, of a neuron that does not move: what pushes it outward."""
    found = with_rows(pushed())
    values = found.unpack(PROBE.run(found).trajectory.final)
    np.testing.assert_allclose(values[found.neuron_index["x"]], RAIL, rtol=1e-6)
    np.testing.assert_allclose(values[found.neuron_index["z_high.x"]], PUSH - RAIL, rtol=1e-5)


def test_rows_start_with_the_currents_of_the_projection():
    found = with_rows(pushed(start=RAIL))
    assert np.ptp(found.start["z_high.x"]) == 0
    assert found.start["z_high.x"][0] == pytest.approx(PUSH - RAIL)
    assert not with_rows(pushed()).start["z_high.x"].any()


@pytest.mark.slow
def test_rows_of_neurons_within_their_rails_start_with_exactly_no_current():
    """A rounding error would become the unit of the row's diode neuron."""
    network = design(lander(), preconditioner=PreconditionerKind.RESISTIVE_GRID).network
    states = np.array([network.start_state, network.start_state])
    scaling = scale(network, ProbeRun(states=states, times=np.arange(2.0), radius=1.0))
    assert not with_rail_rows(network, scaling, RATE).start["z_low.u.up"].any()


def test_loops_of_rows_cross_over_where_they_are_to():
    """For each eigenvalue mu of M: s^2 + (mu + w mu) s + w mu / tau = 0."""
    found = with_rows(pushed())
    tau, expected = SLOWER / FASTER / RATE, []
    w = FASTER * RATE * 3 / 4  # M = [[4, 2], [2, 4]] / 3
    for mu in (2.0, 2 / 3):
        expected += np.roots([1.0, mu + w * mu, w * mu / tau]).tolist()
    modes = spectrum(found, PROBE.run(found).trajectory.final).eigenvalues
    np.testing.assert_allclose(np.sort_complex(modes), np.sort_complex(expected), rtol=1e-6)


def test_a_rail_beyond_full_scale_becomes_no_row():
    found = with_rows(pushed(low=-50.0))
    assert [diode.neuron for diode in found.cell.inequality_duals] == ["z_high.x"]
    assert found.neuron("x").limiter.high == np.inf


@cache
def limited(most=1.2):
    problem = integrator(N=8, dt=0.25, bounds={a: (-most, most)})
    return design(problem, preconditioner=PreconditionerKind.RESISTIVE_GRID).network


def test_a_network_with_rows_settles_where_its_rails_let_it():
    network = limited()
    ideal = PROBE.run(network).trajectory
    found = probed(network, ScalingRules(), silent)
    assert found.rate == pytest.approx(BANDWIDTH * spectrum(network, ideal.final).radius, rel=1e-6)
    wanted, settled = ideal.control_values[-1], found.trajectory.control_values[-1]
    held = np.isclose(np.abs(wanted), np.abs(wanted).max(), rtol=1e-9)
    assert held.sum() == 2
    np.testing.assert_allclose(settled, wanted, atol=1e-6 * np.abs(wanted).max())


def test_a_circuit_that_reaches_no_rail_is_as_fast_as_one_without_rails():
    network = limited(50.0)
    found = probed(network, ScalingRules(), silent)
    assert not found.network.cell.inequality_duals
    assert found.rate == pytest.approx(spectrum(network, found.trajectory.final).radius, rel=1e-6)


def test_amplifiers_of_a_circuit_with_rows_have_room_for_their_inputs():
    circuit, _ = SpiceBackend(level=levels.macro()).prepare(limited())
    scaling = circuit.scaling
    omega = 2 * np.pi * levels.macro().datasheet.gbw * scaling.time
    seen = 0
    for part in circuit.schematic.parts:
        if isinstance(part, PICell | Integrator):
            times = part.rho if isinstance(part, PICell) else 1.0
            units = [scaling.unit[w.source] / scaling.unit[part.name] for w in part.wires]
            gain = np.sum([abs(w.weight) * u * times for w, u in zip(part.wires, units)], axis=0)
            most = GAIN if isinstance(part, PICell) else INTO * omega / scaling.bandwidth_margin
            assert gain.max() < most * (1 + 1e-9)
            seen += 1
    assert seen > 5


def test_circuits_without_rails_of_coupled_neurons_are_not_touched():
    network = design(
        integrator(N=8, dt=0.25), preconditioner=PreconditionerKind.RESISTIVE_GRID
    ).network
    found = probed(network, ScalingRules(), silent)
    assert found.network is network
    run = ProbeRun(states=found.trajectory.states, times=found.trajectory.time, radius=found.rate)
    assert found.rate == spectrum(network, found.trajectory.final).radius
    assert found.scaling.unit == scale(network, run).unit


def test_op_amps_beside_a_grid_are_as_fast_as_its_softest_mode_asks_for():
    network, level = limited(), levels.macro()
    invert = network.preconditioner.inverse(network.layout)
    reached = network.preconditioner.reach(network.layout)[network.places[:, 0]]
    stiffness = np.array([invert(e) for e in np.eye(network.size)])[reached][:, reached]
    across = np.sqrt(np.diag(stiffness))
    softest = np.linalg.eigvalsh(stiffness / np.outer(across, across))[0]
    circuit, _ = SpiceBackend(level=level).prepare(network)
    omega = 2 * np.pi * level.datasheet.usable_bandwidth * circuit.scaling.time
    expected = FOLLOWING / softest / (omega / circuit.scaling.bandwidth_margin)
    assert following_margin(circuit, level) == pytest.approx(expected, rel=1e-6)


def test_a_chosen_margin_is_that_of_long_waves_and_a_given_one_is_obeyed():
    network = design(dint_u(), preconditioner=PreconditionerKind.RESISTIVE_GRID).network
    chosen, _ = SpiceBackend(level=levels.macro()).prepare(network)
    wanted = following_margin(chosen, levels.macro())
    assert 10 < wanted <= chosen.scaling.bandwidth_margin < 1.1 * wanted
    given, _ = SpiceBackend(level=levels.macro(), bandwidth_margin=10.0).prepare(network)
    assert given.scaling.bandwidth_margin == 10


@pytest.mark.slow
def test_a_margin_with_which_long_waves_grow_is_refused_with_one_that_is_enough():
    """At 10 the circuit of the lander grows in ngspice, and its pole model is stable."""
    network = design(lander(), preconditioner=PreconditionerKind.RESISTIVE_GRID).network
    reported = (
        r"margin: 10 is too small: .* resistive grid; use a margin of \d+ "
        r".*PreconditionerKind.CYCLIC_REDUCTION"
    )
    with pytest.raises(NetworkError, match=reported):
        SpiceBackend(level=levels.macro(), bandwidth_margin=10.0).prepare(network)
