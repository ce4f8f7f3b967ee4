"""What the emulation says of a circuit before ngspice runs it, and what ngspice then says."""

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from problems import SUITE
from simulator import needs_ngspice

from ann_dc.analysis.spectra import stability_limit
from ann_dc.backends.ode import OdeBackend
from ann_dc.backends.spice.backend import SpiceBackend, simulate
from ann_dc.backends.spice.circuit_run import refined
from ann_dc.backends.spice.ngspice.runner import Ngspice
from ann_dc.errors import NetworkError
from ann_dc.fidelity.circuit_instance import CircuitInstance
from ann_dc.fidelity.circuit_study import study_circuit
from ann_dc.fidelity.fitting import smallest_margin
from ann_dc.fidelity.prediction import Prediction, Reason, Unpredicted, predict, prediction_of
from ann_dc.gain_design.gain_rule import DIAGONAL_RULE
from ann_dc.gain_design.procedure import design
from ann_dc.hardware.circuit.deviations import rounded_to_series
from ann_dc.hardware.emulation.building import emulate
from ann_dc.hardware.emulation.states import pole_spectrum
from ann_dc.hardware.parts import presets
from ann_dc.hardware.parts.e_series import E24
from ann_dc.hardware.parts.levels import BEHAVIOURAL, TRANSISTOR, macro, ota_c, switched_capacitor
from ann_dc.network.cell import ONE, Cell, Connection, Neuron, Product
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.base import PreconditionerKind
from ann_dc.problem import plants
from ann_dc.solver import synthesize

TIMES = PreconditionerKind.DIAGONAL

PLANTS = {"double_integrator": plants.double_integrator(N=5), "car": SUITE["car"].problem}


@cache
def neighbour_wired(name: str) -> Network:
    return design(synthesize(PLANTS[name]), preconditioner=(PreconditionerKind.DIAGONAL,)).network


@cache
def prepared(name: str, bandwidth_margin: float = 10.0):
    """(components, probe run) for op amps of 10 MHz."""
    return SpiceBackend(level=macro(), bandwidth_margin=bandwidth_margin).prepare(
        neighbour_wired(name)
    )


@cache
def margin_of(name: str) -> float:
    circuit, probe = prepared(name)
    return smallest_margin(circuit, macro(), probe)


def ringing(**given) -> SpiceBackend:
    """The double integrator's circuit with op amps that are a fifth too slow."""
    return SpiceBackend(
        level=macro(), bandwidth_margin=0.8 * margin_of("double_integrator"), **given
    )


# ---- prediction and measurement ------------------------------------------------------------------


@needs_ngspice
@pytest.mark.parametrize("name", ["double_integrator", pytest.param("car", marks=pytest.mark.slow)])
@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_ngspice_finds_what_was_predicted(name, seed):
    """With the errors of single parts of a real preset, all at once."""
    backend = SpiceBackend(level=presets.get("opa192_ad734"), seed=seed)
    circuit, probe = backend.prepare(neighbour_wired(name))
    deviations = backend.deviations(circuit)
    meaning = predict(circuit, backend.level, probe, deviations)
    run = simulate(backend, circuit, probe, deviations)
    assert meaning.stable
    assert meaning.control_error == pytest.approx(run.control_error, rel=0.01)
    assert meaning.settling_time == pytest.approx(run.settling_time(), rel=0.02)
    assert meaning.control_error > 1e-4  # there was something to predict


@pytest.mark.sampled(2)
@needs_ngspice
@pytest.mark.parametrize(
    "level",
    [
        macro(a0=1e3),
        macro(a0=1e5, slew=5e5),
        macro(a0=1e5, multiplier_bandwidth=2e6),
        ota_c(linear_range=10.0),
    ],
    ids=["gain", "slew", "multipliers", "transconductors"],
)
def test_one_defect_alone(level):
    backend = SpiceBackend(level=level)
    circuit, probe = backend.prepare(neighbour_wired("double_integrator"))
    meaning, run = predict(circuit, level, probe), simulate(backend, circuit, probe)
    assert meaning.control_error == pytest.approx(run.control_error, rel=0.01)
    assert meaning.settling_time == pytest.approx(run.settling_time(), rel=0.02)


@needs_ngspice
def test_resistors_from_a_series():
    circuit, probe = prepared("double_integrator")
    off = rounded_to_series(circuit, E24)
    meaning = predict(circuit, macro(), probe, off)
    run = simulate(SpiceBackend(level=macro()), circuit, probe, off)
    assert meaning.control_error == pytest.approx(run.control_error, rel=0.01)
    assert meaning.control_error > 1e-3


def test_half_the_bandwidth_takes_twice_the_time():
    circuit, probe = prepared("double_integrator")
    twice = replace(circuit, scaling=replace(circuit.scaling, time=2 * circuit.scaling.time))
    fast, slow = predict(circuit, macro(), probe), predict(twice, macro(gbw=5e6), probe)
    assert slow.settling_time == pytest.approx(2 * fast.settling_time, rel=1e-6)
    assert slow.control_error == pytest.approx(fast.control_error, rel=1e-6)
    assert slow.spectrum.abscissa == pytest.approx(fast.spectrum.abscissa, rel=1e-6)


def test_the_slowest_pole_sets_the_settling():
    """One more decade takes ln 10 over the abscissa, and 0.1 % is a few of them."""
    circuit, probe = prepared("double_integrator")
    meaning = predict(circuit, macro(), probe)
    decades = (
        meaning.settling_time / circuit.scaling.time * abs(meaning.spectrum.abscissa) / np.log(10)
    )
    assert 1 < decades < 5


# ---- circuits that oscillate ---------------------------------------------------------------------


@pytest.mark.parametrize("name", PLANTS)
def test_the_smallest_margin_parts_circuits_that_settle_from_those_that_ring(name):
    smallest = margin_of(name)
    assert 1 < smallest < 10
    for share, stable in ((0.98, False), (1.03, True)):
        circuit, probe = prepared(name, bandwidth_margin=share * smallest)
        abscissa = pole_spectrum(emulate(circuit, macro()), probe.final).abscissa
        assert (abscissa < 0) == stable, share


def test_the_smallest_margin_does_not_depend_on_the_one_that_was_used():
    circuit, probe = prepared("double_integrator", bandwidth_margin=33.0)
    found = smallest_margin(circuit, macro(), probe)
    assert found == pytest.approx(margin_of("double_integrator"), rel=0.01)


def test_an_unstable_circuit_is_predicted_not_to_settle():
    circuit, probe = ringing().prepare(neighbour_wired("double_integrator"))
    meaning = predict(circuit, macro(), probe)
    assert not meaning.stable
    assert meaning.spectrum.abscissa > 0
    assert np.isnan(meaning.settling_time)
    assert meaning.control_error < 1e-3  # there is an equilibrium, which does not attract


def test_the_backend_refuses_an_unstable_circuit_before_ngspice_starts(monkeypatch):
    monkeypatch.setenv("ANN_DC_NGSPICE", "/nowhere/ngspice")
    backend = ringing()
    bandwidth_margin = re.escape(f"at bandwidth margin {backend.bandwidth_margin:g};")
    with pytest.raises(NetworkError, match=rf"unstable .*\+.* of 1e\+07 Hz .*{bandwidth_margin}"):
        backend.run(neighbour_wired("double_integrator"))


@needs_ngspice
def test_an_unstable_circuit_rings_where_that_is_asked_for():
    run = ringing(require_stable=False).run(neighbour_wired("double_integrator"))
    assert not run.settled()
    last = run.trajectory.time > 2 / 3 * run.trajectory.time[-1]
    controls = run.trajectory.controls[last]
    assert np.ptp(controls, axis=0).max() > 0.1 * np.abs(run.probe.controls[-1]).max()


# ---- circuits that do not settle where the ideal network does ------------------------------------

SQUARE = Cell(
    neurons=(Neuron(name="x"),),
    blocks=(Product(name="xx", a="x", b="x"),),
    connections=(
        Connection(source=ONE, target="x", weight=1.0),
        Connection(source="xx", target="x", weight=-1.0),
    ),
)
"""dx/ds = 1 - x^2: settles at 1 from above -1, and runs away from below."""

PARTS = macro(a0=1e8, output_swing=1.2)
HEADROOM = SpiceBackend().headroom


def off_by(
    share: float, start: float, headroom: float = HEADROOM
) -> tuple[Prediction | Unpredicted, CircuitInstance]:
    """The square's circuit with an offset of the multiplier: dx/ds = 1 - share - x^2."""
    network = Network(cell=SQUARE, stages=1, start={"x": start})
    circuit, probe = SpiceBackend(level=PARTS, headroom=headroom).prepare(network)
    volts = share * circuit.scaling.full_scale / circuit.scaling.unit["xx"]
    deviations = {"oz_xx": np.array([volts])}
    instance = CircuitInstance(circuit=circuit, level=PARTS, probe=probe, deviations=deviations)
    return prediction_of(instance), instance


@pytest.mark.parametrize("share", [0.0, 0.1, 0.5, 0.9])
def test_an_offset_moves_the_equilibrium_to_its_root(share):
    found, _ = off_by(share, start=0.5)
    assert isinstance(found, Prediction)
    assert found.stable
    assert found.control_error == pytest.approx(1 - np.sqrt(1 - share), abs=1e-6)


@pytest.mark.parametrize("share", [1.1, 1.3])
def test_without_a_root_there_is_no_equilibrium(share):
    found, instance = off_by(share, start=0.5)
    assert isinstance(found, Unpredicted)
    assert found.reason is Reason.NO_EQUILIBRIUM
    with pytest.raises(NetworkError, match="no equilibrium near"):
        predict(instance.circuit, PARTS, instance.probe, instance.deviations)


@pytest.mark.parametrize(("share", "clipped"), [(0.1, False), (0.17, False), (0.21, True)])
def test_a_circuit_that_starts_beyond_the_other_root_runs_to_its_rail(share, clipped):
    """From -0.9 it settles while -sqrt(1 - share), which repels, is below that: to 0.19."""
    found, instance = off_by(share, start=-0.9)
    if not clipped:
        assert isinstance(found, Prediction)
        assert np.isfinite(found.settling_time)
        return
    assert isinstance(found, Unpredicted)
    assert found.reason is Reason.CLIPPED
    reported = (
        r"^prediction: .* at their output limits: x of cell 0.*; more headroom does not help: "
        r".* diverged"
    )
    with pytest.raises(NetworkError, match=reported):
        predict(instance.circuit, PARTS, instance.probe, instance.deviations)


def test_a_slew_rate_that_prevents_settling_is_named_with_a_sufficient_remedy():
    """Op amps of 2 V/us follow 8 V at a margin of 30; at 10 they settle without slew limits."""
    network = design(synthesize(plants.double_integrator(N=5)), gain_rule=DIAGONAL_RULE).network
    level = replace(macro(a0=2e5, slew=2e6, output_swing=13.0), full_scale=8.0)
    slow, fast = (
        study_circuit(
            network, SpiceBackend(level=level, bandwidth_margin=margin), simulated=False
        ).prediction
        for margin in (None, 30.0)
    )
    assert "the slew rate of 2 MV/s prevents it from settling" in slow.other_equilibrium
    assert "bandwidth margin above 10" in slow.other_equilibrium
    assert "damp it" not in slow.other_equilibrium
    assert np.isfinite(fast.settling_time)


def test_the_headroom_that_is_told_would_do():
    """It settles at sqrt(1 - share), which is beyond the rails."""
    found, _ = off_by(-3.0, start=0.5)
    assert isinstance(found, Unpredicted)
    assert found.reason is Reason.CLIPPED
    factor = float(re.search(r"([\d.]+) times the headroom is sufficient", found.sentence)[1])
    more, _ = off_by(-3.0, start=0.5, headroom=factor * HEADROOM)
    assert isinstance(more, Prediction)
    assert more.control_error == pytest.approx(1.0, abs=1e-5)
    less, _ = off_by(-3.0, start=0.5, headroom=0.8 * factor * HEADROOM)
    assert isinstance(less, Unpredicted)


# ---- what has no emulation -----------------------------------------------------------------------


def test_ideal_op_amps_are_not_predicted():
    circuit, probe = prepared("double_integrator")
    assert not BEHAVIOURAL.emulated
    with pytest.raises(NetworkError, match=r"^prediction: behavioural circuits.*not emulated"):
        predict(circuit, BEHAVIOURAL, probe)


# ---- switched capacitors -------------------------------------------------------------------------


def clocked(a0: float, share: float = 0.5, **given):
    """A small problem in switched capacitors, with steps of a share of the largest stable one."""
    network = design(
        synthesize(plants.double_integrator(N=3, dt=0.5)), preconditioner=(TIMES,)
    ).network
    probe = OdeBackend(verify=False).run(network).trajectory
    step = share * stability_limit(network, probe.final)
    backend = SpiceBackend(level=switched_capacitor(a0=a0, step=step), **given)
    return backend, *backend.prepare(network)


@needs_ngspice
@pytest.mark.parametrize(
    "a0", [1e2, *(pytest.param(a0, marks=pytest.mark.slow) for a0 in (1e3, 1e4, 1e5))]
)
@pytest.mark.slow
def test_ngspice_finds_what_finite_gain_costs_switched_capacitors(a0):
    backend, circuit, probe = clocked(a0)
    found = predict(circuit, backend.level, probe)
    run = backend.measure(circuit, backend.deck(circuit, probe, {}), probe)
    assert found.stable
    assert found.control_error == pytest.approx(run.control_error, rel=0.01)
    assert found.control_error > 5 / a0


@needs_ngspice
@pytest.mark.slow
@pytest.mark.parametrize(("kind", "size"), [("offset", 1e-3), ("resistor", 1e-2)])
def test_ngspice_finds_what_other_errors_cost_switched_capacitors(kind, size):
    """Resistors stand for the branches of the same weights."""
    backend, circuit, probe = clocked(1e6)
    draws = np.random.default_rng(1)
    wrong = [p.name for p in circuit.parameters if p.kind.value == kind]
    off = {name: draws.normal(0, size, 3) for name in wrong}
    found = predict(circuit, backend.level, probe, off)
    run = backend.measure(circuit, backend.deck(circuit, probe, off), probe)
    assert found.control_error == pytest.approx(run.control_error, rel=0.01)
    assert found.control_error > 1e-3


def test_the_error_of_switched_capacitors_falls_as_one_over_the_gain():
    errors = [predict(c, b.level, p).control_error for b, c, p in map(clocked, (1e3, 1e4, 1e5))]
    assert errors[0] / errors[1] == pytest.approx(10, rel=0.02)
    assert errors[1] / errors[2] == pytest.approx(10, rel=0.02)


def test_a_step_beyond_the_limit_is_predicted_to_oscillate():
    for share, stable in ((0.98, True), (1.02, False)):
        backend, circuit, probe = clocked(1e6, share=share)
        found = predict(circuit, backend.level, probe)
        assert found.stable == stable
        assert np.isnan(found.settling_time)
        assert "not a network in continuous time" in found.unknown


# ---- who is emulated -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    "level", [macro(), macro(differential=True), ota_c(), TRANSISTOR, presets.get("tl072_ad633")]
)
def test_all_others_are_emulated(level):
    assert level.emulated


@pytest.mark.slow
def test_a_circuit_that_gets_lost_on_its_way_is_told():
    """Its settled point attracts, near the optimum; from reset it is not reached.

    With the usual margin of 10 it rings.
    """
    problem = plants.bicycle(N=16)
    network = design(synthesize(problem), gain_rule=DIAGONAL_RULE).network
    study = study_circuit(
        network, SpiceBackend(level=macro(), bandwidth_margin=15), simulated=False
    )
    found = study.prediction
    assert found.stable
    assert found.control_error < 1e-2
    assert np.isnan(found.settling_time)
    assert found.other_equilibrium.startswith("its transient ")
    assert not study.within_tolerance
    assert found.other_equilibrium in study.shortcoming


def test_a_circuit_that_settles_is_not_said_to_be_lost():
    circuit, probe = prepared("car")
    assert predict(circuit, macro(), probe).other_equilibrium == ""


def saddle_flow() -> Network:
    """x' = -(x + lam), lam' = x - 1: rests at 1 and -1."""
    wires = [("x", "x", -1.0), ("lam", "x", -1.0), ("x", "lam", 1.0), (ONE, "lam", -1.0)]
    return hand_wired(("x", "lam"), wires)


def spring(stiffness: float) -> Network:
    """x'' = -4 x' - stiffness (x - 1/2), from 0.8."""
    wires = [("v", "x", 1.0), ("x", "v", -stiffness), ("v", "v", -4.0), (ONE, "v", stiffness / 2)]
    network = hand_wired(("x", "v"), wires)
    return replace(network, start={"x": 0.8})


def hand_wired(names: tuple[str, ...], wires: list[tuple[str, str, float]]) -> Network:
    cell = Cell(
        neurons=tuple(Neuron(name=name) for name in names),
        connections=tuple(Connection(source=s, target=t, weight=w) for s, t, w in wires),
    )
    return Network(cell=cell, stages=1)


@pytest.mark.sampled(2)
@needs_ngspice
@pytest.mark.parametrize(
    "network", [saddle_flow(), spring(4.0), spring(100.0)], ids=["saddle", "spring", "stiff"]
)
def test_hand_wired_network_of_transistors_settles_as_predicted(network):
    """With the gain times frequency of op amps that drive 10 kohm they settled 14 % sooner."""
    backend = SpiceBackend(level=TRANSISTOR, simulator=Ngspice())
    run = refined(backend.run(network), backend.simulator, TRANSISTOR.datasheet)
    said = predict(run.circuit, TRANSISTOR, run.probe)
    assert run.settling_time() == pytest.approx(said.settling_time, rel=0.04)


@needs_ngspice
@pytest.mark.slow
def test_error_of_unicycle_of_transistors_is_that_of_ngspice():
    """Function generators were 36 uV off, by multipliers of small gains, and the error by 6 %."""
    network = design(synthesize(plants.unicycle(N=3)), preconditioner=(TIMES,)).network
    run = SpiceBackend(level=TRANSISTOR, simulator=Ngspice()).run(network)
    said = predict(run.circuit, TRANSISTOR, run.probe)
    assert said.control_error == pytest.approx(run.control_error, rel=0.03)


@needs_ngspice
@pytest.mark.slow
@pytest.mark.parametrize("name", ["opa192_ad734", "zero_drift_trimmed"])
def test_double_integrator_of_op_amps_with_an_output_resistance_settles_as_predicted(name):
    """A swing ends at the edge of the band: 5 % of it decide between 11.1 and 13.8 us."""
    level = presets.get(name)
    network = design(synthesize(plants.double_integrator(N=3)), preconditioner=(TIMES,)).network
    backend = SpiceBackend(level=level, simulator=Ngspice())
    run = refined(backend.run(network), backend.simulator, level.datasheet)
    said = predict(run.circuit, level, run.probe)
    assert run.control_error == pytest.approx(said.control_error, rel=0.02)
    assert run.settling_time() == pytest.approx(said.settling_time, rel=0.02)
