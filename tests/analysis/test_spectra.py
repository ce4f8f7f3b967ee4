"""Spectra against the dense Jacobian, and iterations against dense spectra."""

from dataclasses import replace

import numpy as np
import pytest
from constrained import CONSTRAINED
from designs import designed
from preconditioner_networks import with_preconditioner
from problems import SUITE
from random_preconditioners import with_stiffness
from wired import neighbour_wired

from ann_dc import GainRule, PreconditionerKind, design, synthesize
from ann_dc.analysis.linearisation import Linearisation
from ann_dc.analysis.saddle import penalty_threshold
from ann_dc.analysis.spectra import slowest_modes, spectrum
from ann_dc.backends.spice.backend import SpiceBackend
from ann_dc.evaluation.reference import evaluator
from ann_dc.gain_design.gain_rule import DIAGONAL_RULE, MULTILEVEL_RULE, closed_form
from ann_dc.gain_design.gains import apply_gains
from ann_dc.hardware.emulation.building import emulate
from ann_dc.hardware.emulation.states import pole_spectrum
from ann_dc.hardware.parts import presets
from ann_dc.hardware.parts.levels import macro
from ann_dc.network.cell import Cell, Connection, Neuron
from ann_dc.network.network import Network


def test_spectrum_is_that_of_the_jacobian():
    found = designed("car")
    expected = np.linalg.eigvals(evaluator(found.network).jacobian(found.state))
    assert found.spectrum.eigenvalues.shape == expected.shape
    np.testing.assert_allclose(found.spectrum.radius, np.abs(expected).max(), rtol=1e-9)
    np.testing.assert_allclose(found.spectrum.abscissa, expected.real.max(), rtol=1e-6)
    np.testing.assert_allclose(
        found.spectrum.stiffness_ratio, np.abs(expected).max() / -expected.real.max(), rtol=1e-6
    )


def test_largest_step_is_the_edge_of_forward_euler():
    found = designed("car")
    J = evaluator(found.network).jacobian(found.state)
    radius = lambda h: np.abs(np.linalg.eigvals(np.eye(len(J)) + h * J)).max()  # noqa: E731
    assert (
        radius(0.999 * found.spectrum.largest_step)
        < 1
        < radius(1.001 * found.spectrum.largest_step)
    )


@pytest.mark.parametrize("name", ["dint_u", pytest.param("car_steer", marks=pytest.mark.slow)])
def test_a_neuron_at_its_rail_has_no_mode(name, monkeypatch):
    """The modes are those of the flow among the others, dense and by iterations."""
    found = design(
        synthesize(CONSTRAINED[name].problem), preconditioner=PreconditionerKind.MULTILEVEL
    )
    network, own = found.network, evaluator(found.network)
    saturated = own.saturated(found.state, own.drives(found.state))
    assert saturated.any()
    flow = own.jacobian(found.state)[np.ix_(~saturated, ~saturated)]
    expected = np.linalg.eigvals(flow)
    np.testing.assert_allclose(found.spectrum.abscissa, expected.real.max(), rtol=1e-6)
    assert len(found.spectrum.eigenvalues) == network.size - saturated.sum()
    values, vectors = slowest_modes(network, found.state, 2)
    assert not vectors[saturated].any()
    np.testing.assert_allclose(flow @ vectors[~saturated], vectors[~saturated] * values, atol=1e-8)
    monkeypatch.setattr("ann_dc.analysis.spectra.DENSE_LIMIT", 10)
    ends = spectrum(network, found.state)
    np.testing.assert_allclose(ends.radius, np.abs(expected).max(), rtol=1e-3)
    np.testing.assert_allclose(ends.abscissa, expected.real.max(), rtol=1e-3)


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    "kind",
    [PreconditionerKind.RESISTIVE_GRID, PreconditionerKind.CYCLIC_REDUCTION],
    ids=lambda kind: kind.name.lower(),
)
def test_a_resting_neuron_is_held_while_a_grid_couples_the_others(kind, monkeypatch):
    """The modes are those of the flow with its rails, by complex step, dense and by iterations."""
    found = design(
        synthesize(CONSTRAINED["dint_u"].problem), preconditioner=PreconditionerKind.MULTILEVEL
    )
    network, x = with_stiffness(found.network, kind), found.state
    own = evaluator(network)
    free = ~own.saturated(x, own.drives(x))
    assert not free.all()
    stepped = own.rhs(x + 1e-30j * np.eye(len(x))).imag.T / 1e-30
    expected = np.linalg.eigvals(stepped[np.ix_(free, free)])
    for most in (network.size, 10):
        monkeypatch.setattr("ann_dc.analysis.spectra.DENSE_LIMIT", most)
        modes = spectrum(network, x)
        np.testing.assert_allclose(modes.radius, np.abs(expected).max(), rtol=1e-3)
        np.testing.assert_allclose(modes.abscissa, expected.real.max(), rtol=1e-3)


@pytest.mark.sampled(3)
@pytest.mark.parametrize("name", ["car", "unicycle", "van_der_pol"])
@pytest.mark.parametrize("coordinators", [True, False])
def test_iterations_find_the_ends_of_the_dense_spectrum(name, coordinators, monkeypatch):
    found = designed(name)
    gain_rule = MULTILEVEL_RULE if coordinators else DIAGONAL_RULE
    linear = Linearisation(found.network).at(found.state)
    network = apply_gains(found.network, closed_form(linear, gain_rule, found.first.penalty_factor))
    dense, threshold = spectrum(network, found.state), penalty_threshold(network, found.state)
    monkeypatch.setattr("ann_dc.analysis.spectra.DENSE_LIMIT", 10)
    ends = spectrum(network, found.state)
    assert len(ends.eigenvalues) < len(dense.eigenvalues)
    np.testing.assert_allclose(ends.radius, dense.radius, rtol=1e-3)
    np.testing.assert_allclose(ends.abscissa, dense.abscissa, rtol=1e-3)
    np.testing.assert_allclose(penalty_threshold(network, found.state), threshold, rtol=1e-2)


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    ("problem", "stages", "penalty_factor"), [("crane", 20, 64.0), ("cart_pole", 25, 4.0)]
)
def test_slow_modes_that_swing_are_not_missed(problem, stages, penalty_factor, monkeypatch):
    """Rightmost modes that iterations do not find all, further from zero than others."""
    declared = {**CONSTRAINED, **SUITE}[problem].problem.with_horizon(stages)
    plain = synthesize(declared)
    linear, gain_rule = (
        Linearisation(plain).at(plain.start_state),
        GainRule(kind=PreconditionerKind.DIAGONAL),
    )
    network = apply_gains(plain, closed_form(linear, gain_rule, penalty_factor))
    expected = spectrum(network, plain.start_state).abscissa
    monkeypatch.setattr("ann_dc.analysis.spectra.DENSE_LIMIT", 10)
    found = spectrum(network, plain.start_state).abscissa
    assert found == pytest.approx(expected, rel=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize(
    "slower", [*(pytest.param(c, marks=pytest.mark.slow) for c in (1.2, 1.0)), 0.9]
)
def test_modes_of_op_amps_that_swing_between_the_ends_are_not_missed(slower, monkeypatch):
    """A board whose resistors and capacitances at virtual grounds leave it near its threshold."""
    level = replace(presets.get("opa192_ad734"), smallest_resistor=10e3)
    board = SpiceBackend(level=level, bandwidth_margin=10.0)
    circuit, probe = board.prepare(neighbour_wired("car"))
    circuit = circuit.slower(slower)
    expected = pole_spectrum(emulate(circuit, level), probe.final)
    monkeypatch.setattr("ann_dc.hardware.emulation.states.ALL_MODES", 10)
    found = pole_spectrum(emulate(replace(circuit), level), probe.final)  # another one: no cache
    assert len(found.eigenvalues) < len(expected.eigenvalues)
    assert found.abscissa == pytest.approx(expected.abscissa, rel=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("problem", "kind"),
    [
        pytest.param("double_integrator", PreconditionerKind.MULTILEVEL, marks=pytest.mark.slow),
        pytest.param(
            "double_integrator", PreconditionerKind.COUPLED_MULTILEVEL, marks=pytest.mark.slow
        ),
        pytest.param("car", PreconditionerKind.MULTILEVEL, marks=pytest.mark.slow),
        ("unicycle", PreconditionerKind.DIAGONAL),
    ],
)
def test_modes_that_swing_and_hardly_decay_are_not_missed(problem, kind, monkeypatch):
    """Op amps behind coordinators: fast modes that do not swing hide them from most iterations."""
    built = SpiceBackend(level=macro(), bandwidth_margin=30.0)
    circuit, probe = built.prepare(with_preconditioner(problem, kind))
    expected = pole_spectrum(emulate(circuit, built.level), probe.final)
    monkeypatch.setattr("ann_dc.hardware.emulation.states.ALL_MODES", 10)
    found = pole_spectrum(emulate(replace(circuit), built.level), probe.final)
    assert len(found.eigenvalues) < len(expected.eigenvalues)
    assert found.abscissa == pytest.approx(expected.abscissa, rel=1e-6)


@pytest.mark.sampled(1)
@pytest.mark.parametrize("growing", [2.0, 9.5])
def test_what_grows_fast_and_does_not_swing_is_not_missed(growing):
    """Among modes from 1e-3 to 10 that decay: none near it, and none faster."""
    rates = -np.geomspace(1e-3, 10.0, 700)
    rates[350] = growing
    cell = Cell(
        neurons=(Neuron(name="x"),), connections=(Connection(source="x", target="x", weight=rates),)
    )
    network = Network(cell=cell, stages=len(rates))
    assert spectrum(network, np.zeros(len(rates))).abscissa == pytest.approx(growing, rel=1e-6)
