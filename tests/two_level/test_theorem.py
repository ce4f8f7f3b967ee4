"""Theorem IV.1 against stages solved in NumPy, IV.2 against Hessians that CasADi derives."""

from functools import cache

import casadi as ca
import numpy as np
import pytest
from car_by_hand import solved_stage
from closed_chains import CAR, closed_chain
from costates import costates
from designs import designed, near_start, small
from problems import SUITE
from reference import casadi_functions, ipopt

from ann_dc.decomposition.equations import decompose
from ann_dc.decomposition.form import CORRECTED, switch
from ann_dc.evaluation.populations import neuron_values
from ann_dc.gain_design.gains import apply_gains, manual_gains
from ann_dc.network.network import COORDINATION, Network
from ann_dc.problem import plants
from ann_dc.problem.initial_guess import InitialGuess
from ann_dc.solver import synthesize
from ann_dc.synthesis.row import start_values
from ann_dc.two_level.levels import TwoLevels
from ann_dc.two_level.theorem import (
    Following,
    Hypothesis,
    PrintedMatrices,
    StageHessians,
    theorem_IV_1,
    theorem_IV_2,
)
from ann_dc.two_level.upper_level import Gradient

NEURON = switch("S14")
FORMS = pytest.mark.parametrize("form", [CORRECTED, NEURON], ids=["q_0 given", "q_0 a neuron"])


def casadi_eigenvalues(problem, q, u, mu, form) -> list[np.ndarray]:
    """Of the Hessian of l + mu'f in (q_k, u_k); stage 0 has u alone where q_0 is given."""
    step, cost, _ = casadi_functions(problem)
    z, m = ca.SX.sym("z", problem.n + problem.m), ca.SX.sym("m", problem.n)
    none = ca.DM(0, 1)
    stage = z[: problem.n], z[problem.n :], none
    hessian = ca.Function("hessian", [z, m], [ca.hessian(cost(*stage) + m.T @ step(*stage), z)[0]])
    values = []
    for k in range(problem.horizon):
        block = hessian(np.concatenate([q[:, k], u[:, k]]), mu[:, k]).full()
        if k == 0 and not form.start_is_neuron:
            block = block[problem.n :, problem.n :]
        values.append(np.linalg.eigvalsh(block))
    return values


def at_optimum(problem, form):
    """The hypothesis at IPOPT's optimum, and CasADi's eigenvalues there."""
    found = ipopt(problem)
    mu, beta = costates(problem, found.q, found.u)
    network = synthesize(decompose(problem, form))
    start = InitialGuess(q=found.q, u=found.u, mu=mu, beta=beta)
    given = theorem_IV_2(network, start_values(network, start))
    return given, casadi_eigenvalues(problem, found.q, found.u, mu, form)


def assert_same(given: Hypothesis, expected: list[np.ndarray]) -> None:
    assert len(given.eigenvalues) == len(expected)
    scale = max(abs(e).max() for e in expected)
    for values, known in zip(given.eigenvalues, expected):
        np.testing.assert_allclose(values, known, atol=1e-6 * scale)


@FORMS
def test_it_fails_for_the_car(form):
    """A control times a function of the state: the Hessian is indefinite."""
    given, expected = at_optimum(plants.car(), form)
    assert_same(given, expected)
    assert not given.holds
    assert given.failing == tuple(k for k, e in enumerate(expected) if e[0] < -1e-6)
    worst = min(range(9), key=lambda k: expected[k][0])
    low, high = expected[worst][0], expected[worst][-1]
    assert low < -1.0
    assert str(given) == (
        f"the hypothesis of Theorem IV.2 fails at {len(given.failing)} of 9 stages; worst at "
        f"k = {worst}, where dG_k/dv_k has eigenvalues {low:.4g} .. {high:.4g}"
    )


@FORMS
@pytest.mark.parametrize("name", ["van_der_pol", "bicycle", "pendulum_state_cost"])
def test_eigenvalues_are_in_the_users_units(name, form):
    given, expected = at_optimum(SUITE[name].problem.with_horizon(8), form)
    assert_same(given, expected)


def test_away_from_the_solution_it_reads_what_the_network_works_with():
    """m = mu + rho (f - t) stands wherever mu stands."""
    network, problem, rho = small("car", NEURON), SUITE["car"].problem.with_horizon(4), 0.7
    x = near_start(network, seed=1)
    values = {}
    for row, neuron in zip(network.unpack(x), network.cell.neurons):
        values.setdefault(neuron.population, []).append(neuron.scale.user(row))
    q, u, t, mu = (np.array(values[name]) for name in ("q", "u", "t", "mu"))
    rows = zip(problem.states, problem.functions.map(q, u) - t)
    multipliers = mu + [
        rho * network.neuron(f"mu.{s}").scale.factor * c / network.neuron(f"q.{s}").scale.factor
        for s, c in rows
    ]
    expected = casadi_eigenvalues(problem, q, u, multipliers, NEURON)
    assert_same(theorem_IV_2(network, x), expected)


@FORMS
@pytest.mark.parametrize("weight", [1.0, 0.25])
def test_it_holds_for_quadratic_cost_and_a_linear_map(weight, form):
    """dG_k/dv_k = diag(c, .., c, 1, 1)."""
    network = synthesize(decompose(plants.lq(state_weight=weight, N=5), form))
    given = theorem_IV_2(network, near_start(network, seed=2))
    for k, values in enumerate(given.eigenvalues):
        states = 0 if k == 0 and not form.start_is_neuron else 4
        np.testing.assert_allclose(values, np.sort([weight] * states + [1.0, 1.0]), rtol=1e-9)
    assert given.holds
    assert given.failing == ()
    assert given.definite == (0, 1, 2, 3, 4)
    assert str(given) == (
        "the hypothesis of Theorem IV.2 holds: every dG_k/dv_k is positive semi-definite, 5 of 5 "
        "are positive definite"
    )


def test_least_effort_alone_is_not_definite():
    """dG_k/dv_k = diag(0, 0, 1)."""
    network = synthesize(decompose(plants.double_integrator(N=5), NEURON))
    given = theorem_IV_2(network, network.start_state)
    np.testing.assert_allclose(given.eigenvalues, [[0.0, 0.0, 1.0]] * 5, atol=1e-12)
    assert (given.failing, given.definite, given.holds) == ((), (), False)
    assert str(given) == (
        "the hypothesis of Theorem IV.2 fails: every dG_k/dv_k is positive semi-definite, but none "
        "is positive definite"
    )


def test_one_definite_stage_is_enough():
    semi, definite, negative = np.array([0.0, 1.0]), np.array([0.5, 2.0]), np.array([-0.1, 3.0])
    assert Hypothesis(eigenvalues=(semi, definite, semi)).holds
    assert not Hypothesis(eigenvalues=(semi, semi)).holds
    mixed = Hypothesis(eigenvalues=(definite, negative, semi))
    assert (mixed.failing, mixed.definite, mixed.holds) == ((1,), (0,), False)


def test_rounding_is_no_sign():
    rounded = Hypothesis(eigenvalues=(np.array([-1e-12, 1.0]), np.array([1e-12, 1.0])))
    assert (rounded.failing, rounded.definite) == ((), ())


# ---- the printed matrices ----------------------------------------------------------------------


def test_the_printed_matrices_say_the_same_of_every_state():
    """diag(0.99, 0.1) is positive definite: the hypothesis holds wherever, and says nothing."""
    network = small("car", NEURON)
    for x in (network.start_state, near_start(network, seed=3), 10 * near_start(network, seed=4)):
        given = theorem_IV_2(network, x, matrices=PrintedMatrices())
        assert given.holds
        assert given.definite == tuple(range(network.stages))
        for values in given.eigenvalues:
            np.testing.assert_array_equal(values, [0.1, 0.1, 0.99, 0.99, 0.99, 0.99])


def test_they_are_not_the_hessians_of_the_paper_s_own_example():
    """(31), (32) leave out mu, which multiplies second derivatives of the map."""
    found = closed_chain(CAR)
    printed, own = (
        matrices.of(found.network, found.state) for matrices in (PrintedMatrices(), StageHessians())
    )
    for k, (claimed, true) in enumerate(zip(printed, own)):
        np.testing.assert_array_equal(claimed, np.diag([0.99] * 4 + [0.1] * 2))
        np.testing.assert_allclose(true[:2], 0.0, atol=1e-9)  # nothing depends on x and y
        np.testing.assert_allclose(true[4:, 4:], np.eye(2), atol=1e-9)  # of the cost
        assert k in (0,) or np.abs(true[2:4, 2:4]).max() > 1.0
    names = [n.name for n in found.network.cell.neurons if n.population in ("q", "u")]
    assert names == ["q.x", "q.y", "q.phi", "q.varphi", "u.nu", "u.eta"]


# ---- Theorem IV.1 ------------------------------------------------------------------------------


@cache
def plain() -> Network:
    """The car on the plain Lagrangian, so that a stage reads its own t and beta alone."""
    network = closed_chain(CAR).network
    return apply_gains(network, manual_gains(network))


def reported(push: np.ndarray):
    """Distances after stages that solve for the solution's t and beta, pushed (n_c,)."""
    settled = closed_chain(CAR).state
    x = settled.copy()
    x[plain().of_population(*COORDINATION)] += push
    layer = TwoLevels(plain(), upper=Gradient(lambda_t=0.1, lambda_beta=0.1))
    return layer.run(x, settled=settled, limit=0)


def factors(*populations: str) -> np.ndarray:
    """Of the user's units over the network's, one a neuron of these populations."""
    neurons = plain().cell.neurons
    return np.array([n.scale.factor for n in neurons if n.population in populations])


def coordination_size() -> int:
    return int(plain().of_population(*COORDINATION).sum())


def test_the_errors_of_the_stages_are_those_that_numpy_finds():
    push = 1e-3 * np.random.default_rng(0).standard_normal(coordination_size())
    run = reported(push)
    ours, settled = (neuron_values(plain(), x) for x in (run.states[0], closed_chain(CAR).state))
    near = np.hstack([settled[p] for p in ("q", "u", "mu")])
    stages = np.array([*map(solved_stage, ours["t"], ours["beta"], near)])
    exact = np.array([*map(solved_stage, settled["t"], settled["beta"], near)])
    error = (stages - exact) / factors("q", "u", "mu")
    np.testing.assert_allclose(run.distances.v, np.linalg.norm(error[:, :6]), rtol=1e-5)
    np.testing.assert_allclose(run.distances.mu, np.linalg.norm(error[:, 6:]), rtol=1e-5)
    np.testing.assert_allclose(run.distances.reported, np.linalg.norm(push), rtol=1e-9)
    np.testing.assert_allclose(run.lyapunov.theta, 0.5 * push @ push, rtol=1e-9)


@cache
def norms_by_differences() -> tuple[float, float]:
    """K_v and K_mu: stages are told one number after the other, a little off."""
    settled, h = neuron_values(plain(), closed_chain(CAR).state), 1e-6
    near = np.hstack([settled[p] for p in ("q", "u", "mu")])
    of_t, of_beta, of_l = factors("t"), factors("beta"), factors("q", "u", "mu")
    largest = np.zeros(2)
    for k, guess in enumerate(near):
        columns = []
        for i in range(8):
            last, push = k == len(near) - 1, h * np.eye(8)[i]
            if last and i < 4:
                continue  # t_{N-1} is q_d: nothing tells it
            up, down = (
                solved_stage(
                    settled["t"][k] + sign * push[:4] * of_t,
                    settled["beta"][k] + sign * push[4:] * of_beta,
                    guess,
                )
                for sign in (1, -1)
            )
            columns.append((up - down) / (2 * h) / of_l)
        block = np.array(columns).T
        largest = np.maximum(largest, [np.linalg.norm(block[:6], 2), np.linalg.norm(block[6:], 2)])
    return float(largest[0]), float(largest[1])


def test_the_rate_is_that_of_differences():
    found = theorem_IV_1(plain(), closed_chain(CAR).state)
    np.testing.assert_allclose((found.v, found.mu), norms_by_differences(), rtol=1e-4)


@pytest.mark.parametrize("size", [1e-3, 1e-5])
def test_the_stages_follow_as_the_theorem_says(size):
    """No push moves them further than the rate, to first order, and the errors vanish with it."""
    bound, rng = theorem_IV_1(plain(), closed_chain(CAR).state), np.random.default_rng(1)
    for _ in range(3):
        push = rng.standard_normal(coordination_size())
        run = reported(size * push / np.linalg.norm(push))
        assert 0 < run.distances.v[0, 0] <= bound.v * size * (1 + 100 * size)
        assert 0 < run.distances.mu[0, 0] <= bound.mu * size * (1 + 100 * size)


def test_with_q_0_constant_the_theorem_has_nothing_to_say():
    found = theorem_IV_1(designed("car").network, designed("car").state)
    assert found == Following(v=np.inf, mu=np.inf)
    assert "does not apply" in str(found)
