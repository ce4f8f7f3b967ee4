"""Several objectives as circuits: shares of the objectives in ngspice against the ODE's."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from minimax import CASES, car, small
from simulator import needs_ngspice

from ann_dc import SpiceBackend, design, emulate, equilibrium, levels, presets, spectrum
from ann_dc.backends.spice.circuit_run import refined
from ann_dc.backends.spice.netlist.timing import Simulation
from ann_dc.backends.spice.ngspice.runner import Ngspice
from ann_dc.evaluation.populations import kkt_point
from ann_dc.fidelity.circuit_instance import CircuitInstance
from ann_dc.fidelity.prediction import predict
from ann_dc.hardware.circuit.bill import bill_of
from ann_dc.hardware.circuit.deviations import draw
from ann_dc.hardware.emulation.states import emulated_state
from ann_dc.hardware.parts.datasheet import Tolerances
from ann_dc.hardware.parts.e_series import E96
from ann_dc.hardware.schematic.elements import Integrator, PICell

MACRO = levels.macro()
BUILT = (levels.BEHAVIOURAL, MACRO, levels.TRANSISTOR)
PROBLEMS = {
    "one stage": lambda: replace(small(1), q_d=(0, 1)),
    "one counts": lambda: small(weights={"effort": 0.99, "error": 0.01}),
    "both count": small,
    "softened": lambda: small(temperature=0.3),
    "thirty stages": lambda: small(30),
    "beside rows": lambda: small(stages=12, bounds={"v": (None, 1.2), "a": (-9, 9)}),
    "car": lambda: car(CASES["two by range"][0]),
}
MARGIN = {"one counts": 16.0, "beside rows": 16.0, "car": 25.0}
POINTS = {"one stage": 1200}  # it rings for long: a quarter of ngspice's largest step


@cache
def network_of(name):
    return design(PROBLEMS[name](), preconditioner=SpiceBackend().kinds).network


def backend_of(name, level) -> SpiceBackend:
    patient = Simulation(points=POINTS.get(name, 300), patience=1800.0)
    return SpiceBackend(level=level, bandwidth_margin=MARGIN.get(name, 10.0), simulation=patient)


@cache
def prepared(name, level):
    return backend_of(name, level).prepare(network_of(name))


def shares(network, x) -> np.ndarray:
    return kkt_point(network, x)[-1]


@needs_ngspice
@pytest.mark.sampled(1)
@pytest.mark.parametrize("level", BUILT[:2], ids=lambda level: level.name)
@pytest.mark.parametrize(
    "name",
    ["both count", *(pytest.param(n, marks=pytest.mark.slow) for n in ("one stage", "one counts"))],
)
def test_shares_are_those_of_the_ode(name, level):
    run = backend_of(name, level).run(network_of(name))
    assert run.settled()
    found, wanted = (shares(network_of(name), t.final) for t in (run.trajectory, run.probe))
    np.testing.assert_allclose(found, wanted, atol=5e-5 if level is MACRO else 5e-6)
    if level is MACRO:
        reported = predict(run.circuit, MACRO, run.probe)
        assert run.control_error == pytest.approx(reported.control_error, rel=0.1, abs=3e-5)
        run = refined(run, Ngspice(), MACRO.datasheet)
        assert run.settling_time() == pytest.approx(reported.settling_time, rel=0.02)


@pytest.mark.slow
@needs_ngspice
def test_shares_behind_output_resistances_settle_as_predicted():
    level = presets.get("opa192_ad734")
    run = SpiceBackend(level=level).run(network_of("both count"))
    reported = predict(run.circuit, level, run.probe)
    assert run.control_error == pytest.approx(reported.control_error, rel=0.01)
    run = refined(run, Ngspice(), level.datasheet)
    assert run.settling_time() == pytest.approx(reported.settling_time, rel=0.01)


@pytest.mark.slow
@needs_ngspice
def test_softened_shares_are_exponentials_of_generators():
    run = backend_of("softened", MACRO).run(network_of("softened"))
    assert run.settled()
    found, wanted = (shares(network_of("softened"), t.final) for t in (run.trajectory, run.probe))
    np.testing.assert_allclose(found, wanted, atol=2e-4)


@needs_ngspice
@pytest.mark.slow
def test_transistors_share_as_their_gain_allows():
    """Op amps of 68 dB."""
    run = backend_of("both count", levels.TRANSISTOR).run(network_of("both count"))
    found, wanted = (
        shares(run.circuit.schematic.network, t.final) for t in (run.trajectory, run.probe)
    )
    np.testing.assert_allclose(found, wanted, atol=1e-3)
    reported = predict(run.circuit, levels.TRANSISTOR, run.probe)
    assert run.control_error == pytest.approx(reported.control_error, rel=0.2)


@pytest.mark.slow
@needs_ngspice
@pytest.mark.parametrize("level", BUILT[:2], ids=lambda level: level.name)
@pytest.mark.parametrize("name", ["thirty stages", "beside rows", "car"])
def test_larger_ones_share_as_the_ode_does(name, level):
    run = backend_of(name, level).run(network_of(name))
    assert run.settled()
    found, wanted = (shares(network_of(name), t.final) for t in (run.trajectory, run.probe))
    np.testing.assert_allclose(found, wanted, atol=5e-4 if level is MACRO else 1e-5)
    if level is MACRO:
        reported = predict(run.circuit, MACRO, run.probe)
        assert run.control_error == pytest.approx(reported.control_error, rel=0.2)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", ["one stage", "one counts", "both count"])
def test_emulated_op_amps_settle_where_the_network_does(name):
    circuit, probe = prepared(name, MACRO)
    emulation = emulate(circuit, levels.macro(a0=1e8))
    start = emulated_state(emulation, probe.final)
    assert spectrum(emulation.network, start).abscissa < 0
    x = equilibrium(emulation.network, start)
    np.testing.assert_allclose(emulation.controls(x), probe.control_values[-1].ravel(), atol=1e-5)


def test_an_objective_is_one_amplifier_and_one_integrator():
    circuit, _ = prepared("both count", MACRO)
    schematic, cell = circuit.schematic, circuit.schematic.network.cell
    duals, objectives = len(cell.duals), len(cell.objectives)
    assert schematic.count(PICell) == 5 * duals + objectives
    assert schematic.count(Integrator) == 5 * 5 + objectives + 1  # q, u, t; J and E
    rows = [row.split(",") for row in bill_of(circuit, MACRO, E96).splitlines()]
    amplifiers = [r[0] for r in rows if r[1] in ("x_j_effort", "x_e_max", "x_zeta_j_error")]
    assert amplifiers == ["4"] * 3
    sending = [r[0] for r in rows if r[-1] == "resistor from a*a to J.effort"]
    assert sending == ["0", "1", "2", "3", "4"]


@needs_ngspice
def test_parts_that_are_off_move_the_shares_as_emulated():
    """With the errors of real parts in every cell and on the lines, ngspice follows Newton."""
    circuit, probe = prepared("both count", MACRO)
    off = draw(circuit.parameters, Tolerances(resistor=4e-3, offset=1e-5, gain=1e-3), seed=3)
    backend = backend_of("both count", MACRO)
    run = backend.measure(circuit, backend.deck(circuit, probe, off), probe)
    instance = CircuitInstance(circuit=circuit, level=MACRO, probe=probe, deviations=off)
    wanted = instance.emulation.controls(instance.settled)
    moved = np.abs(wanted - probe.control_values[-1].ravel()).max()
    assert moved > 100 * 1e-5
    np.testing.assert_allclose(run.trajectory.control_values[-1].ravel(), wanted, atol=0.02 * moved)
