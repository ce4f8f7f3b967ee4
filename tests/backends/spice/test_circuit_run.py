"""Runs of circuits read back, on the hardest level: CMOS op amps and Gilbert multipliers."""

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from problems import SUITE
from reference import ipopt
from simulator import needs_ngspice

from ann_dc.analysis.spectra import spectrum
from ann_dc.backends.spice.backend import SpiceBackend
from ann_dc.backends.spice.circuit_run import OVERLOAD, CircuitRun, read_back
from ann_dc.backends.spice.netlist.deck import deck_of
from ann_dc.backends.spice.ngspice.raw import Raw
from ann_dc.backends.spice.ngspice.runner import Ngspice
from ann_dc.backends.trajectory import Trajectory
from ann_dc.gain_design.procedure import design
from ann_dc.hardware.circuit.cost import OP_AMP
from ann_dc.hardware.parts.levels import TRANSISTOR, macro
from ann_dc.network.preconditioners.base import PreconditionerKind
from ann_dc.problem import plants
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.solution.solution import certificate_of
from ann_dc.solver import synthesize

BEHAVIOURAL = re.compile(r"^\s*B|^\s*[EGFH]\w*\b.*\b(value|vol|cur|poly|table|laplace)\b", re.I)
"""A card that computes: a B source, or a controlled one that is more than a gain."""


def cards(text: str) -> list[str]:
    """Lines without comments, continued ones joined."""
    return [line for line in text.replace("\n+", " ").splitlines()[1:] if line[:1] != "*"]


OSCILLATOR = SUITE["van_der_pol"].problem.with_horizon(4)


@cache
def run_of(problem: OptimalControlProblem) -> CircuitRun:
    network = design(synthesize(problem), preconditioner=(PreconditionerKind.DIAGONAL,)).network
    return SpiceBackend(level=TRANSISTOR).run(network)


@pytest.mark.slow
@needs_ngspice
def test_the_car_in_transistors_settles_near_the_optimum():
    problem = SUITE["car"].problem
    run = run_of(problem)
    assert run.settled()
    assert run.control_error <= 5e-3
    assert run.settling_time() <= 15e-6
    certificate = certificate_of(problem, run.trajectory.network, run.trajectory.final)
    assert certificate.objective == pytest.approx(SUITE["car"].optima[0], rel=1e-2)


@needs_ngspice
def test_it_finds_the_objective_of_the_optimum():
    run = run_of(OSCILLATOR)
    certificate = certificate_of(OSCILLATOR, run.trajectory.network, run.trajectory.final)
    assert certificate.objective == pytest.approx(ipopt(OSCILLATOR).objective, rel=1e-2)


@needs_ngspice
def test_there_is_no_behavioural_source_in_it():
    found = cards(run_of(OSCILLATOR).deck.text)
    assert not [card for card in found if BEHAVIOURAL.search(card)]
    kinds = {card.split()[0][0].upper() for card in found if card and card[0] != "."}
    assert "B" not in kinds
    assert {"M", "Q"} <= kinds  # MOS op amps, bipolar multipliers


def test_a_behavioural_source_would_be_found():
    assert BEHAVIOURAL.search("b1 0 out I=tanh(v(x))")
    assert BEHAVIOURAL.search("E1 out 0 value={v(a)*v(b)}")
    assert BEHAVIOURAL.search("G1 out 0 cur='v(a)^2'")
    assert not BEHAVIOURAL.search("G1 0 out o2 o1 {(8.197-0.0057*vm)*vm*(1+ge)/10m}")
    assert not BEHAVIOURAL.search("V_btn value 0 1")


@needs_ngspice
def test_nothing_clips_without_being_told():
    run = run_of(OSCILLATOR)
    assert run.overloads == ()
    network, scaling = run.trajectory.network, run.scaling
    states = network.unpack(run.trajectory.states)
    parts = [name for name in network.neuron_index if name in scaling.unit]
    assert len(parts) > 5
    for name in parts:
        volts = scaling.volts(name, states[:, network.neuron_index[name]])
        assert np.abs(volts).max() < OVERLOAD * scaling.full_scale, name


def test_a_circuits_curves_are_over_seconds(tmp_path):
    network = design(
        synthesize(plants.double_integrator(N=3)), preconditioner=(PreconditionerKind.DIAGONAL,)
    ).network
    circuit, probe = SpiceBackend().prepare(network)
    deck = SpiceBackend().deck(circuit, probe, {})
    run = CircuitRun(trajectory=probe, deck=deck, overloads=(), probe=probe, circuit=circuit)
    run.to_npz(tmp_path / "curves.npz")
    with np.load(tmp_path / "curves.npz") as file:
        np.testing.assert_array_equal(file["time"], probe.time * deck.timing.unit)
        np.testing.assert_array_equal(file["u.a"], probe["u.a"])
        assert dict(file["units"])["time"] == "s"
    run.to_csv(tmp_path / "curves.csv")
    assert (tmp_path / "curves.csv").read_text().startswith("time (s),")


def test_circuit_run_at_rest_has_finite_mean_square_error():
    """The ODE's states are all zero: a hundredth of a scale stands for them."""
    network = design(
        synthesize(plants.double_integrator(N=3)), preconditioner=(PreconditionerKind.DIAGONAL,)
    ).network
    circuit, probe = SpiceBackend().prepare(network)
    deck = SpiceBackend().deck(circuit, probe, {})
    time = np.array([0.0, 1.0, 3.0])
    zero = Trajectory(
        network=network, time=time, states=np.zeros((3, network.size)),
        residual_time=time, residuals=np.zeros((3, 2)),
    )  # fmt: skip
    off = replace(zero, states=np.eye(1, network.size) * np.full((3, 1), 1e-3))
    for found, error in ((zero, 0.0), (off, 0.01)):
        run = CircuitRun(trajectory=found, deck=deck, overloads=(), probe=zero, circuit=circuit)
        assert run.mean_square_error == pytest.approx(error)


def test_tightest_node_is_the_one_that_the_overloads_name():
    """Every node of two cells at its share of full scale; m.x goes beyond it."""
    network = design(
        synthesize(plants.double_integrator(N=3)), preconditioner=(PreconditionerKind.DIAGONAL,)
    ).network
    backend = SpiceBackend(level=macro())
    circuit, probe = backend.prepare(network)
    deck = backend.deck(circuit, probe, {})
    time = np.linspace(0.0, deck.timing.release * 10, 5)
    names = ("time", *deck.signals.values())
    values = np.full((5, len(names)), 0.1)
    values[:, 0] = time
    high = next(node for (name, _), node in deck.signals.items() if name == "m.x")
    for top, overloads in ((0.5, 0), (1.42, 1)):
        values[:, names.index(high)] = top
        raw = Raw(title="", plot="Transient Analysis", names=names, values=values.copy())
        run = read_back(circuit, deck, raw, probe)
        assert run.fullest == f"m.x at {top:.0%}"
        assert len(run.overloads) == overloads
        assert all("the model does not clip" in str(node) for node in run.overloads)


# ---- size ----------------------------------------------------------------------------------------


@needs_ngspice
@pytest.mark.slow
def test_eighty_stages_of_op_amps_follow_the_ode():
    """Over 543 fastest time constants; ``tests/bench/circuits.py`` times a whole run."""
    network = design(
        synthesize(plants.car(N=80)), preconditioner=(PreconditionerKind.DIAGONAL,)
    ).network
    backend = SpiceBackend(level=macro(), simulator=Ngspice(timeout=180))
    circuit, probe = backend.prepare(network)
    duration = 543 / spectrum(network, probe.final).radius
    written = deck_of(circuit, backend.level, duration=duration)
    assert written.parts[OP_AMP] > 2000
    raw = backend.simulator.run(written.text, end_time=written.end)
    assert read_back(circuit, written, raw, probe).mean_square_error < 1e-2
