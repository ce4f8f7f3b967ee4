"""Causes of slow settling, against closed forms: rates, exact preconditioner, waves."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from designs import small
from exact_preconditioner import exact_preconditioner, is_dual
from problems import SUITE

from ann_dc.analysis.slowness import LIMIT, Cause, Mode, slowness_of
from ann_dc.analysis.spectra import spectrum
from ann_dc.errors import NetworkError
from ann_dc.gain_design.gain_rule import MULTILEVEL_RULE
from ann_dc.gain_design.gains import apply_gains, manual_gains
from ann_dc.gain_design.procedure import Design, design
from ann_dc.network.cell import Cell, Connection, Neuron
from ann_dc.network.network import Network
from ann_dc.solver import synthesize

MEASURED = ("car", "van_der_pol", "pendulum", "double_integrator", "planar_quadrotor")


@cache
def designed(name: str) -> Design:
    """With a pyramid and equal weights of the rows."""
    return design(synthesize(SUITE[name].problem), gain_rule=MULTILEVEL_RULE)


def slowness(name):
    return slowness_of(designed(name).network, designed(name).state)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", MEASURED)
def test_a_rate_is_curvature_and_penalty_over_energy(name):
    for mode in slowness(name).modes:
        assert mode.curvature + mode.penalty == pytest.approx(mode.rate, rel=1e-4)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", MEASURED)
def test_an_oscillation_has_half_of_its_energy_in_the_duals(name):
    for mode in slowness(name).modes:
        if mode.oscillates:
            assert mode.dual_share == pytest.approx(0.5, abs=1e-4)


@pytest.mark.parametrize("name", MEASURED)
def test_modes_are_the_slowest_of_the_spectrum(name):
    found = slowness(name)
    rates = [mode.rate for mode in found.modes]
    assert rates == sorted(rates)
    assert found.spectrum.abscissa == pytest.approx(-rates[0], rel=1e-4)
    assert found.ratio == designed(name).spectrum.stiffness_ratio
    for mode in found.modes:
        assert mode.shares.sum() == pytest.approx(1.0)
        assert (mode.shares >= 0).all()


def test_a_large_network_has_the_same_modes(monkeypatch):
    dense = slowness("van_der_pol")
    monkeypatch.setattr("ann_dc.analysis.spectra.DENSE_LIMIT", 0)
    for few, all_of_them in zip(slowness("van_der_pol").modes, dense.modes):
        assert few.eigenvalue == pytest.approx(all_of_them.eigenvalue, rel=1e-4)
        np.testing.assert_allclose(few.shares, all_of_them.shares, atol=1e-3)
        assert few.sensitivity == pytest.approx(all_of_them.sensitivity, rel=1e-2)


def test_the_penalty_it_takes_is_the_threshold():
    found, rho = slowness("pendulum"), designed("pendulum").rho_star
    assert found.rho_star == rho
    (penalty,) = {row.penalty for row in found.rows}
    assert -found.lowest * penalty == pytest.approx(rho)


# ---- rows ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["car", "pendulum"])
def test_rows_are_blocks_of_the_shadow_stiffness(name):
    network, x = designed(name).network, designed(name).state
    exact = exact_preconditioner(network, x)
    Q, owner = exact.saddle.sensitivity, network.places[exact.saddle.dual, 0]
    for row in slowness_of(network, exact.state).rows:
        own = owner == network.neuron_index[row.neuron]
        block = Q[np.ix_(own, own)]
        np.testing.assert_allclose(row.at_stage, np.diag(block), atol=1e-9)
        values = np.linalg.eigvalsh(block)
        np.testing.assert_allclose([row.lowest, row.highest], values[[0, -1]], atol=1e-9)
        assert row.penalty * row.reach == pytest.approx(np.abs(values).max())


def test_the_shadow_stiffness_of_a_double_integrator_is_least_effort():
    """Pushes delta on the way cost delta' P' (R R')^{-1} P delta / 2 to make good.

    R takes controls to the final state, P pushes, by the scale of a state; in units of the
    objective, which one number fixes.
    """
    network = small("double_integrator")
    N, dt = network.stages, 0.1
    F, b = np.array([[1, dt], [0, 1]]), np.array([0, dt])
    power = lambda k: np.linalg.matrix_power(F, k)  # noqa: E731
    R = np.column_stack([power(N - 1 - k) @ b for k in range(N)])
    exact = exact_preconditioner(network, network.start_state)
    pushes = []
    for neuron, stage in network.places[exact.saddle.dual]:
        population, component = network.cell.neurons[neuron].name.split(".")
        after = N - 1 - stage + (population == "beta")
        size = network.neuron(f"q.{component}").scale.factor
        pushes.append(size * power(after)[:, ("x", "v").index(component)])
    P = np.column_stack(pushes)
    expected = P.T @ np.linalg.solve(R @ R.T, P)
    Q = exact.saddle.sensitivity
    np.testing.assert_allclose(np.abs(Q) / Q[0, 0], np.abs(expected) / expected[0, 0], atol=1e-9)


# ---- the exact preconditioner --------------------------------------------------------------------


def exact_and_weights(name, above):
    """Uneven weights, so large that H + A'WA is positive definite."""
    exact = exact_preconditioner(designed(name).network, designed(name).state)
    count = len(exact.network.cell.neurons)
    weights = np.where(is_dual(exact.network), np.linspace(1.0, 3.0, count), 0.0)
    low, high = exact.saddle.sensitivity_range(exact.weights(weights))
    return exact, max(above * -low, 0.2 * high) * weights


@pytest.mark.sampled(4)
@pytest.mark.parametrize("name", ["car", "pendulum", "cstr", "double_integrator"])
@pytest.mark.parametrize("eta", [0.3, 1.5])
def test_modes_of_the_exact_preconditioner(name, eta):
    """s = -1, or s^2 + s + eta kappa = 0 with kappa = 1 / (1 + q/w)."""
    exact, rho = exact_and_weights(name, above=1.5)
    root = np.sqrt(exact.weights(rho))
    kappa = 1 / (1 + np.linalg.eigvalsh(exact.saddle.sensitivity / np.outer(root, root)))
    pairs = np.sqrt(0.25 - eta * kappa + 0j)
    rest = -np.ones(len(exact.saddle.primal) - len(kappa))
    expected = np.concatenate([-0.5 + pairs, -0.5 - pairs, rest])
    network = exact.with_gains(rho, eta)
    found = spectrum(network, exact.state).eigenvalues
    for value in expected:
        assert np.abs(found - value).min() < 1e-5
    for mode in slowness_of(network, exact.state).modes:
        s = mode.eigenvalue
        if mode.dual_share > 1e-6:
            assert abs(s**2 + s + eta / (1 + mode.sensitivity)) < 1e-5


@pytest.mark.parametrize("name", ["car", "pendulum", "cstr", "double_integrator"])
def test_the_ratio_of_the_exact_preconditioner_with_given_penalties(name):
    exact, rho = exact_and_weights(name, above=1.2)
    frozen = slowness_of(exact.with_gains(rho, eta=0.5), exact.state)
    best = 0.25 * (1 + frozen.highest)
    reached = spectrum(exact.with_gains(rho, best), exact.state).stiffness_ratio
    assert reached == pytest.approx(frozen.exact_ratio(), rel=1e-4)
    for eta in (0.9 * best, 1.1 * best):  # no other rate of the duals does better
        assert spectrum(exact.with_gains(rho, eta), exact.state).stiffness_ratio > reached - 1e-4


@pytest.mark.parametrize("name", ["car", "pendulum", "cstr", "double_integrator"])
def test_needed_is_where_the_limit_is_reached(name):
    found = slowness(name)
    assert found.exact_ratio(found.needed) == pytest.approx(LIMIT)
    assert found.exact_ratio(0.9 * found.needed) > LIMIT
    exact = exact_preconditioner(designed(name).network, designed(name).state)
    rho = found.needed * np.array(designed(name).gains.rho)
    eta = 0.25 * (1 + found.highest / found.needed)
    assert spectrum(exact.with_gains(rho, eta), exact.state).stiffness_ratio == pytest.approx(
        2.0, abs=1e-3
    )


def test_below_the_threshold_there_is_no_exact_preconditioner():
    found = slowness("pendulum")
    assert found.lowest < -1
    assert found.exact_ratio() == float("inf")


# ---- modes ---------------------------------------------------------------------------------------


def mode(**changes) -> Mode:
    plain = Mode(
        eigenvalue=-0.1 + 0j,
        names=("q.x", "mu.x"),
        shape=np.array([[0.6, 0.0], [0.0, 0.8]]),
        dual_share=0.64,
        curvature=0.05,
        penalty=0.05,
        sensitivity=0.0,
    )
    return replace(plain, **changes)


@pytest.mark.parametrize("count", [0, 1, 2, 5])
def test_sign_changes_of_a_wave(count):
    stages = np.arange(200)
    wave = np.cos(np.pi * count * (stages + 0.5) / 200)
    faint = 0.01 * (-1.0) ** stages  # no sign of its own
    shape = np.array([wave + faint, 0.1 * faint])
    shape[1, 0] = np.nan  # an absent neuron
    assert mode(shape=shape).sign_changes == count


def test_a_mode_in_words():
    reported = str(mode(eigenvalue=-0.1 + 0.2j, shape=np.array([[0.6, 0.0], [0.5, -0.6]])))
    assert reported == "-0.1 +- 0.2i: mu.x 61 %, q.x 36 %; 1 sign change"
    assert str(mode()) == "-0.1: mu.x 64 %, q.x 36 %; no sign change"


@pytest.mark.parametrize(
    ("sensitivity", "dual_share", "cause"),
    [
        (3.0, 0.5, Cause.REACH),
        (-3.0, 0.5, Cause.CURVATURE),
        (0.5, 0.5, Cause.PRECONDITIONER),
        (3.0, 0.0, Cause.PRECONDITIONER),
    ],
)
def test_causes(sensitivity, dual_share, cause):
    assert mode(sensitivity=sensitivity, dual_share=dual_share).cause is cause


@pytest.mark.parametrize(
    ("name", "cause"),
    [
        ("planar_quadrotor", Cause.REACH),
        ("pendulum", Cause.CURVATURE),
        pytest.param("two_link_arm", Cause.PRECONDITIONER, marks=pytest.mark.slow),
    ],
)
def test_causes_of_networks_with_a_pyramid(name, cause):
    assert slowness(name).modes[0].cause is cause


# ---- bad input -----------------------------------------------------------------------------------


def test_a_network_without_duals_is_refused():
    leak = Network(
        cell=Cell(
            neurons=(Neuron(name="x"),),
            connections=(Connection(source="x", target="x", weight=-1.0),),
        ),
        stages=2,
    )
    with pytest.raises(NetworkError, match="no PI dual neurons"):
        slowness_of(leak, leak.start_state)


def test_a_row_without_a_penalty_is_refused():
    network = small("double_integrator")
    plain = apply_gains(network, manual_gains(network, rho={"beta": 1.0}))
    with pytest.raises(NetworkError, match=r"mu\.x has no penalty.*manual_gains"):
        slowness_of(plain, plain.start_state)
