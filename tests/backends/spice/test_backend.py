"""Networks compiled to circuits and simulated by ngspice: the same trajectory, the same optimum."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import sympy as sp
from preconditioner_networks import with_preconditioner
from problems import SUITE
from simulator import needs_ngspice

from ann_dc.backends.spice.backend import SpiceBackend, simulate
from ann_dc.backends.spice.ngspice.runner import Ngspice
from ann_dc.errors import NetworkError, SpiceError
from ann_dc.gain_design.gain_rule import DIAGONAL_RULE
from ann_dc.gain_design.procedure import design
from ann_dc.hardware.circuit.deviations import combined, draw, rounded_to_series
from ann_dc.hardware.parts.datasheet import Tolerances
from ann_dc.hardware.parts.e_series import E12
from ann_dc.hardware.parts.foundry import SKY130
from ann_dc.hardware.parts.levels import BEHAVIOURAL, macro, ota_c, switched_capacitor
from ann_dc.network.cell import Cell, Connection, Neuron
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.base import PreconditionerKind
from ann_dc.problem import plants
from ann_dc.problem.step_length import StepLength
from ann_dc.solution.solution import certificate_of
from ann_dc.solver import synthesize


@cache
def neighbour_wired(name: str) -> Network:
    return design(
        synthesize(SUITE[name].problem), preconditioner=(PreconditionerKind.DIAGONAL,)
    ).network


@cache
def prepared(name: str):
    return SpiceBackend().prepare(neighbour_wired(name))


@cache
def run_of(name: str, level=BEHAVIOURAL, coordinated: bool = False):
    network = (
        with_preconditioner(name, PreconditionerKind.MULTILEVEL)
        if coordinated
        else neighbour_wired(name)
    )
    return SpiceBackend(level=level).run(network)


# ---- the ladder against the ODE ------------------------------------------------------------------


@pytest.mark.sampled(1)
@needs_ngspice
@pytest.mark.parametrize("coordinated", [False, True])
def test_the_papers_car_on_ideal_parts_is_the_ode(coordinated):
    run = run_of("car", coordinated=coordinated)
    assert run.mean_square_error < 1e-5
    assert run.control_error < 1e-5
    assert run.overloads == ()


def test_a_foundrys_transistors_are_given_longer_and_decks_are_counted(monkeypatch):
    asked: list[Ngspice] = []

    def run(simulator, deck, **_):
        asked.append(simulator)
        raise SpiceError("not run")

    monkeypatch.setattr(Ngspice, "run", run)
    lines: list[str] = []
    circuit, probe = prepared("double_integrator")
    deck = SpiceBackend().deck(circuit, probe, {})
    for level in (BEHAVIOURAL, SKY130):
        with pytest.raises(SpiceError):
            SpiceBackend(level=level, progress=lines.append).measure(circuit, deck, probe)
    assert [simulator.timeout for simulator in asked] == [120.0, 3600.0]
    asked[0].progress("1 of 2 decks")
    assert lines[-1] == "1 of 2 decks"


@needs_ngspice
def test_a_free_start_and_a_step_length_that_is_chosen_are_parts_like_others():
    """Cell 0 has a live q, and a wire less from its b."""
    given, h = plants.double_integrator(N=4, q_0=(0, None)), sp.Symbol("h")
    cost = h * (1 + given.cost + given.states[1] ** 2)
    problem = replace(given, dt=StepLength(low=0.1, high=2.0), cost=cost)
    network = design(synthesize(problem), preconditioner=(PreconditionerKind.DIAGONAL,)).network
    run = SpiceBackend().run(network)
    assert run.mean_square_error < 1e-5
    assert run.control_error < 1e-5


def test_ideal_parts_build_no_grid():
    network = with_preconditioner("double_integrator", PreconditionerKind.RESISTIVE_GRID, 5)
    with pytest.raises(NetworkError, match="behavioural circuits cannot build a resistive grid"):
        SpiceBackend().run(network)


@pytest.mark.slow
@needs_ngspice
@pytest.mark.parametrize("name", ["double_integrator", "unicycle", "van_der_pol", "cstr"])
def test_other_plants_on_ideal_parts(name):
    run = run_of(name)
    assert run.mean_square_error < 1e-5
    assert run.control_error < 1e-5


@needs_ngspice
def test_the_circuit_settles_to_a_certified_optimum():
    run = run_of("car")
    certificate = certificate_of(SUITE["car"].problem, neighbour_wired("car"), run.trajectory.final)
    assert certificate.objective == pytest.approx(SUITE["car"].optima[0], rel=1e-5)
    assert certificate.kkt_residual < 1e-5


MACRO = {a0: macro(a0=a0) for a0 in (1e4, 1e5, 1e6)}


@needs_ngspice
def test_op_amps_with_a_million_of_gain_and_no_other_error():
    assert run_of("car", MACRO[1e6]).control_error < 1e-4


@pytest.mark.slow
@needs_ngspice
def test_the_error_of_finite_gain_falls_as_one_over_the_gain():
    """A dual integrator that leaks leaves a residual of mu / A0."""
    errors = {a0: run_of("car", level).control_error for a0, level in MACRO.items()}
    assert errors[1e4] / errors[1e5] == pytest.approx(10, rel=0.1)
    assert errors[1e5] / errors[1e6] == pytest.approx(10, rel=0.1)


@pytest.mark.slow
@needs_ngspice
def test_settling_scales_with_the_bandwidth():
    slow, fast = (run_of("car", macro(a0=1e5, gbw=gbw)).settling_time() for gbw in (1e6, 10e6))
    assert slow / fast == pytest.approx(10, rel=0.05)


@pytest.mark.slow
@needs_ngspice
def test_rails_that_clip_are_told():
    """A clipped circuit settles quietly to a wrong point."""
    with pytest.raises(NetworkError, match=r"clip at 0.7 V.*use at most 0.63 V"):
        SpiceBackend(level=macro(a0=1e5, output_swing=0.7)).run(neighbour_wired("car"))
    circuit, probe = SpiceBackend(level=macro(a0=1e5)).prepare(neighbour_wired("car"))
    tight = SpiceBackend(level=macro(a0=1e5, output_swing=0.7), require_stable=False)
    run = simulate(tight, circuit, probe)  # scaled for other op amps
    assert run.settled()
    assert run.control_error > 1e-2
    assert any("beyond its limit of 0.63 V" in str(overload) for overload in run.overloads)
    high = SpiceBackend(level=BEHAVIOURAL, headroom=1.01).run(neighbour_wired("car"))
    assert "above 0.95 V; the model does not clip" in str(high.overloads[0])


# ---- names ---------------------------------------------------------------------------------------


def hostile(name: str) -> Network:
    """A leaky neuron of that name, driven by a bias."""
    cell = Cell(
        neurons=(Neuron(name=name), Neuron(name=name.upper() + " b")),
        connections=(
            Connection(source=name, target=name, weight=-1.0),
            Connection(source="one", target=name),
            Connection(source=name, target=name.upper() + " b"),
            Connection(source=name.upper() + " b", target=name.upper() + " b", weight=-2.0),
        ),
    )
    return Network(cell=cell, stages=2)


@needs_ngspice
@pytest.mark.parametrize(
    "name", ["x y", "x;rm -rf /", ".end", "x__1", "{x}", "$(id)", "ä", "q.n", "0", "a" * 100]
)
def test_hostile_names_are_only_names(name):
    run = SpiceBackend().run(hostile(name))
    np.testing.assert_allclose(run.trajectory.final, [1.0, 0.5, 1.0, 0.5], atol=1e-5)


# ---- bad input -----------------------------------------------------------------------------------


def test_a_network_that_does_not_settle_cannot_be_scaled():
    cell = Cell(
        neurons=(Neuron(name="x"),), connections=(Connection(source="x", target="x", weight=1.0),)
    )
    with pytest.raises(NetworkError, match="settle"):
        SpiceBackend().run(Network(cell=cell, stages=1, start={"x": 1.0}))


@pytest.mark.parametrize("setting", ["a0", "gbw", "slew", "output_swing", "rout"])
def test_a_parameter_out_of_range_is_named(setting):
    with pytest.raises(NetworkError, match=setting):
        macro(**{setting: -1.0})


# ---- resistors of a series -----------------------------------------------------------------------


def test_what_the_seed_draws_comes_on_top_of_what_the_series_does():
    backend = SpiceBackend(level=macro(tolerances=Tolerances(resistor=1e-2, offset=1e-3)))
    circuit, _ = backend.prepare(neighbour_wired("double_integrator"))
    off = rounded_to_series(circuit, E12)
    drawn = draw(circuit.parameters, backend.level.tolerances, 3)
    assert backend.deviations(circuit) == {}
    for given, expected in (
        ({"series": E12}, off),
        ({"series": E12, "seed": 3}, combined(circuit.parameters, off, drawn)),
    ):
        found = replace(backend, **given).deviations(circuit)
        assert found.keys() == expected.keys()
        assert all(np.array_equal(found[name], expected[name]) for name in found)


@pytest.mark.parametrize(
    "level", [ota_c(), switched_capacitor(step=0.1)], ids=lambda level: level.name
)
def test_a_level_without_resistors_takes_no_series(level):
    with pytest.raises(NetworkError, match=r"series E12: .* circuits have no resistors"):
        SpiceBackend(level=level, series=E12).prepare(neighbour_wired("double_integrator"))


@pytest.mark.slow
def test_a_circuit_that_only_exact_parts_keep_from_ringing_is_told_so():
    """With resistors of E12 it needs a larger margin than with exact ones."""
    network = design(synthesize(plants.two_link_arm(N=3)), gain_rule=DIAGONAL_RULE).network
    backend = SpiceBackend(level=macro(), series=E12, bandwidth_margin=9.5)
    circuit, probe = backend.prepare(network)
    with pytest.raises(
        NetworkError, match=r"use parts with smaller tolerances, or raise the margin above 9\.5"
    ):
        simulate(backend, circuit, probe)
