"""rho*, above which the augmented Hessian is positive definite, against dense algebra."""

import numpy as np
import pytest
import scipy.linalg
import scipy.optimize
import sympy as sp
from costates import costates
from designs import designed
from reference import ipopt
from scipy.optimize import brentq

from ann_dc.analysis.saddle import penalty_threshold
from ann_dc.analysis.spectra import spectrum
from ann_dc.evaluation.reference import evaluator
from ann_dc.gain_design.gains import apply_gains, manual_gains
from ann_dc.network.cell import Role
from ann_dc.network.network import Network
from ann_dc.optimality.certificate import certify
from ann_dc.problem import plants
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.problem.initial_guess import InitialGuess
from ann_dc.problem.scales import Scales
from ann_dc.solver import synthesize
from ann_dc.synthesis.row import start_values


def kkt_matrices(network: Network, x: np.ndarray):
    """(H, A) dense, from the drives of the network with rho = 0 and no coordinators."""
    plain = apply_gains(network, manual_gains(network))
    jacobian = evaluator(plain).jacobian(x)
    dual = np.array([plain.cell.neurons[p].role is Role.DUAL for p, _ in plain.places])
    return -jacobian[np.ix_(~dual, ~dual)], jacobian[np.ix_(dual, ~dual)]


def test_threshold_of_the_car_by_bisection():
    found = designed("car")
    H, A = kkt_matrices(found.network, found.state)
    smallest = lambda rho: np.linalg.eigvalsh(H + rho * A.T @ A)[0]  # noqa: E731
    np.testing.assert_allclose(brentq(smallest, 1e-3, 1e3), found.rho_star, rtol=1e-4)


@pytest.mark.parametrize("name", ["car", "van_der_pol"])
def test_positive_definite_above_the_threshold_only(name):
    found = designed(name)
    H, A = kkt_matrices(found.network, found.state)
    np.testing.assert_allclose(H, H.T, atol=1e-12 * np.abs(H).max())
    smallest = lambda rho: np.linalg.eigvalsh(H + rho * A.T @ A)[0]  # noqa: E731
    assert smallest(1.001 * found.rho_star) > 0
    assert smallest(0.999 * found.rho_star) < 0


def indefinite_lq(stages: int = 3) -> OptimalControlProblem:
    """x' = x + a with cost (a^2 - x^2 / 5) / 2 and a fixed end: H indefinite, optimum unique."""
    x, a = sp.symbols("x a")
    cost = (a**2 - x**2 / 5) / 2
    return OptimalControlProblem(
        states=(x,), controls=(a,), map=(x + a,), cost=cost, horizon=stages, q_0=(1,), q_d=(2,)
    )


def test_threshold_of_a_tiny_problem_by_hand():
    problem = indefinite_lq()
    network = synthesize(problem, scales=Scales.none(problem))
    # z = (a_0, t_0, q_1, a_1, t_1, q_2, a_2); rows: the three maps, the two couplings
    H = np.diag([1, 0, -0.2, 1, 0, -0.2, 1])
    A = np.array(
        [
            [1, -1, 0, 0, 0, 0, 0],
            [0, 0, 1, 1, -1, 0, 0],
            [0, 0, 0, 0, 0, 1, 1],
            [0, -1, 1, 0, 0, 0, 0],
            [0, 0, 0, 0, -1, 1, 0],
        ]
    )
    tangent = scipy.linalg.null_space(A)
    assert np.linalg.eigvalsh(tangent.T @ H @ tangent)[0] > 0
    expected = scipy.optimize.brentq(
        lambda rho: np.linalg.eigvalsh(H + rho * A.T @ A)[0], 1e-6, 1e3, xtol=1e-12
    )
    found = penalty_threshold(network, network.start_state)
    np.testing.assert_allclose(found, expected, rtol=1e-8)


def test_convex_problems_need_no_penalty():
    assert designed("double_integrator").rho_star < 1e-9


def test_above_the_threshold_every_choice_of_rates_is_stable():
    found = designed("car")
    rng = np.random.default_rng(0)
    for _ in range(5):
        rho = 1.1 * found.rho_star
        tau = {n.name: float(10 ** rng.uniform(-1, 1)) for n in found.network.cell.neurons}
        network = apply_gains(found.network, manual_gains(found.network, rho=rho, tau=tau))
        assert spectrum(network, found.state).abscissa < 0


def test_the_plain_flow_leaves_the_optimum():
    """Section 2 of the equations: with unit gains and rho = 0 the largest real part is +80."""
    problem = plants.car()
    found = ipopt(problem)
    np.testing.assert_allclose(found.objective, 398.6315, rtol=1e-6)
    mu, beta = costates(problem, found.q, found.u)
    network = synthesize(problem, scales=Scales.none(problem))
    network = apply_gains(network, manual_gains(network, rho=0.0, tau=1.0))
    x = start_values(network, InitialGuess(q=found.q, u=found.u, mu=mu, beta=beta))
    assert np.abs(evaluator(network).rhs(x)).max() < 1e-5 * np.abs(x).max()
    np.testing.assert_allclose(spectrum(network, x).abscissa, 80, rtol=0.05)
    certified = certify(problem, found.q[:, :-1], found.u, found.q[:, 1:], mu, beta)
    assert certified.second_order
