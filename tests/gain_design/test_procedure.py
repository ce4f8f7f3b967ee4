"""Gains and spectra against dense algebra, the paper's figures and measured runs."""

import numpy as np
import pytest
import scipy.linalg
import scipy.optimize
import sympy as sp
from costates import costates
from designs import designed, slower
from hypothesis import given, settings
from hypothesis import strategies as st
from reference import ipopt

from ann_dc.analysis.linearisation import Linearisation
from ann_dc.analysis.second_order import penalty_threshold
from ann_dc.analysis.spectra import spectrum
from ann_dc.backends.ode import OdeBackend, Settling
from ann_dc.errors import DesignError, UnknownNameError
from ann_dc.evaluation.reference import evaluator
from ann_dc.gain_design.gains import apply_gains, hand_gains
from ann_dc.gain_design.procedure import design
from ann_dc.gain_design.recipe import WITH_COORDINATORS, WITHOUT_COORDINATORS, closed_form
from ann_dc.network.cell import Cell, Connection, Neuron, Role
from ann_dc.network.network import Network
from ann_dc.optimality.certificate import certify
from ann_dc.problem import plants
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.problem.start import Start
from ann_dc.solver import synthesize
from ann_dc.synthesis.normalisation import Normalisation
from ann_dc.synthesis.synthesis import start_values


def kkt_matrices(network: Network, x: np.ndarray):
    """(H, A) dense, from the drives of the network with rho = 0 and no coordinators."""
    plain = apply_gains(network, hand_gains(network))
    jacobian = evaluator(plain).jacobian(x)
    dual = np.array([plain.cell.neurons[p].role is Role.DUAL for p, _ in plain.places])
    return -jacobian[np.ix_(~dual, ~dual)], jacobian[np.ix_(dual, ~dual)]


# ---- rho* --------------------------------------------------------------------------------------


def test_threshold_of_the_normalised_car():
    np.testing.assert_allclose(designed("car").rho_star, 1.03, rtol=0.01)


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
    network = synthesize(problem, normalisation=Normalisation.none(problem))
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
        network = apply_gains(found.network, hand_gains(found.network, rho=rho, tau=tau))
        assert spectrum(network, found.state).abscissa < 0


def test_the_plain_flow_leaves_the_optimum():
    """Section 2 of the equations: with unit gains and rho = 0 the largest real part is +80."""
    problem = plants.car()
    found = ipopt(problem)
    np.testing.assert_allclose(found.objective, 398.6315, rtol=1e-6)
    mu, beta = costates(problem, found.q, found.u)
    network = synthesize(problem, normalisation=Normalisation.none(problem))
    network = apply_gains(network, hand_gains(network, rho=0.0, tau=1.0))
    x = start_values(network, Start(q=found.q, u=found.u, mu=mu, beta=beta))
    assert np.abs(evaluator(network).rhs(x)).max() < 1e-5 * np.abs(x).max()
    np.testing.assert_allclose(spectrum(network, x).abscissa, 80, rtol=0.05)
    certified = certify(problem, found.q[:, :-1], found.u, found.q[:, 1:], mu, beta)
    assert certified.second_order


# ---- spectrum ----------------------------------------------------------------------------------


def test_spectrum_is_that_of_the_jacobian():
    found = designed("car")
    expected = np.linalg.eigvals(evaluator(found.network).jacobian(found.state))
    assert found.spectrum.eigenvalues.shape == expected.shape
    np.testing.assert_allclose(found.spectrum.radius, np.abs(expected).max(), rtol=1e-9)
    np.testing.assert_allclose(found.spectrum.abscissa, expected.real.max(), rtol=1e-6)
    np.testing.assert_allclose(
        found.spectrum.ratio, np.abs(expected).max() / -expected.real.max(), rtol=1e-6
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


@pytest.mark.parametrize("name", ["car", "unicycle", "van_der_pol"])
@pytest.mark.parametrize("coordinators", [True, False])
def test_iterations_find_the_ends_of_the_dense_spectrum(name, coordinators, monkeypatch):
    found = designed(name)
    recipe = WITH_COORDINATORS if coordinators else WITHOUT_COORDINATORS
    linear = Linearisation(found.network).at(found.state)
    network = apply_gains(found.network, closed_form(linear, recipe, found.best.boost))
    dense, threshold = spectrum(network, found.state), penalty_threshold(network, found.state)
    monkeypatch.setattr("ann_dc.analysis.spectra.DENSE_LIMIT", 10)
    ends = spectrum(network, found.state)
    assert len(ends.eigenvalues) < len(dense.eigenvalues)
    np.testing.assert_allclose(ends.radius, dense.radius, rtol=1e-3)
    np.testing.assert_allclose(ends.abscissa, dense.abscissa, rtol=1e-3)
    np.testing.assert_allclose(penalty_threshold(network, found.state), threshold, rtol=1e-2)


# ---- design ------------------------------------------------------------------------------------

MEASURED = ("car", "unicycle", "bicycle", "van_der_pol", "double_integrator")


@pytest.mark.parametrize("name", MEASURED)
def test_settling_is_predicted(name):
    found = designed(name)
    assert found.settled
    run = OdeBackend(verify=False).run(found.network)
    assert run.status.settled
    np.testing.assert_allclose(run.settling_time, found.predicted_settling(), rtol=0.25)


def test_the_smallest_ratio_won():
    found = designed("car")
    assert len(found.candidates) >= 6
    assert found.spectrum.ratio == min(c.ratio for c in found.candidates)
    assert found.spectrum.ratio < 20  # settling independent of N needs tens, not thousands


def test_network_carries_the_gains():
    found = designed("car")
    network, gains = found.network, found.gains
    assert network.coordinators is gains.coordinators
    for row, neuron in enumerate(network.cell.neurons):
        np.testing.assert_allclose(1 / np.asarray(neuron.tau), gains.rate[row, 0], rtol=1e-14)
    paths = {c.name: c.weight for c in network.cell.connections}
    for dual in network.cell.duals:
        rho = gains.rho[network.neuron_index[dual.neuron]]
        assert paths[f"{dual.multiplier}<-{dual.residual}"] == rho


def test_design_says_what_it_did():
    text = str(designed("car"))
    assert text.startswith("first run      settled in ")
    for word in ("frozen with", "rho* = 1.03", "radius", "abscissa", "predicted"):
        assert word in text


def test_design_without_duals():
    leak = Network(
        cell=Cell(
            neurons=(Neuron(name="x"),),
            connections=(Connection(source="x", target="x", weight=-1.0),),
        ),
        stages=2,
    )
    with pytest.raises(DesignError, match=r"no PI dual neurons.*by hand"):
        design(leak)


def test_refinement_never_makes_it_worse():
    network = synthesize(plants.double_integrator(N=4))
    plain, refined = design(network), design(network, refine=True)
    assert refined.spectrum.ratio <= plain.spectrum.ratio
    assert refined.best.recipe.penalty != plain.best.recipe.penalty


def test_a_fixed_recipe_is_kept():
    found = design(synthesize(plants.double_integrator(N=4)), recipe=WITHOUT_COORDINATORS)
    assert found.best.recipe is WITHOUT_COORDINATORS
    assert found.network.coordinators is None


def test_progress_is_told():
    meaning = []
    design(synthesize(plants.double_integrator(N=3)), progress=meaning.append)
    assert meaning[0].startswith("first run: step ")
    assert meaning[-1] == "freeze: rehearsal 1"


@settings(max_examples=6, deadline=None)
@given(c=st.floats(0.05, 20.0))
def test_time_scaling(c):
    network = designed("double_integrator").network
    backend = OdeBackend(verify=False, settling=Settling(tolerance=1e-4))
    base, scaled = backend.run(network), backend.run(slower(network, c))
    assert scaled.status.settled
    np.testing.assert_allclose(scaled.settling_time, c * base.settling_time, rtol=0.01)
    x = network.start_state
    np.testing.assert_allclose(
        evaluator(slower(network, c)).rhs(x), evaluator(network).rhs(x) / c, rtol=1e-10
    )


# ---- by hand -----------------------------------------------------------------------------------


def test_hand_gains_by_name_and_population():
    network = synthesize(plants.car(N=3))
    gains = hand_gains(network, rho={"mu": 2.0, "mu.phi": 3.0}, tau={"q": 0.5})
    row = network.neuron_index
    assert gains.rho[row["mu.x"]] == 2.0
    assert gains.rho[row["mu.phi"]] == 3.0
    assert gains.rho[row["beta.x"]] == 0.0
    assert gains.rho[row["q.x"]] == 0.0
    assert (gains.rate[row["q.y"]] == 2.0).all()
    assert (gains.rate[row["mu.y"]] == 1.0).all()
    assert gains.coordinators is None


@pytest.mark.parametrize(
    ("given", "error", "message"),
    [
        ({"tau": 0.0}, DesignError, "tau: time constants must be positive, got 0.0"),
        ({"tau": -1.0}, DesignError, "tau"),
        ({"tau": np.nan}, DesignError, "tau"),
        ({"tau": np.inf}, DesignError, "tau"),
        ({"tau": {"q.x": 0.0}}, DesignError, "tau.*'q.x': 0.0"),
        ({"rho": -0.1}, DesignError, "rho: penalties must be zero or positive, got -0.1"),
        ({"rho": np.nan}, DesignError, "rho"),
        ({"rho": {"nu": 1.0}}, UnknownNameError, "neuron or population 'nu'.*mu.varphi"),
        ({"tau": {"q.z": 1.0}}, UnknownNameError, "'q.z' does not exist"),
    ],
)
def test_hand_gains_that_are_refused(given, error, message):
    with pytest.raises(error, match=message):
        hand_gains(synthesize(plants.car(N=2)), **given)


def test_applied_gains_survive_a_second_time():
    network = synthesize(plants.car(N=3))
    once = apply_gains(network, hand_gains(network, rho=2.0, tau=0.1))
    twice = apply_gains(once, hand_gains(once, rho=3.0, tau=0.2))
    direct = apply_gains(network, hand_gains(network, rho=3.0, tau=0.2))
    x = network.start_state + 0.1
    np.testing.assert_array_equal(evaluator(twice).rhs(x), evaluator(direct).rhs(x))
