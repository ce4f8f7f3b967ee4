"""The hypothesis of Theorem IV.2, against Hessians that CasADi derives."""

import casadi as ca
import numpy as np
import pytest
from costates import costates
from designs import near_start, small
from problems import SUITE
from reference import casadi_functions, ipopt

from ann_dc.decomposition import CORRECTED, decompose, switch
from ann_dc.problem import Start, plants
from ann_dc.solver import synthesize
from ann_dc.synthesis import start_values
from ann_dc.two_level import Hypothesis, theorem_IV_2

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
    start = Start(q=found.q, u=found.u, mu=mu, beta=beta)
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
