"""The upper level's map, against the iteration itself."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from designs import small

from ann_dc.analysis.equilibria import equilibrium
from ann_dc.decomposition.equations import decompose
from ann_dc.decomposition.form import switch
from ann_dc.errors import DesignError
from ann_dc.gain_design.gain_rule import MULTILEVEL_RULE
from ann_dc.gain_design.gains import apply_gains, manual_gains
from ann_dc.gain_design.procedure import design
from ann_dc.network.network import COORDINATION
from ann_dc.network.preconditioners.base import PreconditionerKind
from ann_dc.problem import plants
from ann_dc.solver import synthesize
from ann_dc.two_level.levels import TwoLevels
from ann_dc.two_level.upper_gains import UpperGains, UpperMap
from ann_dc.two_level.upper_level import Gradient, NewtonCoordinator

PROBLEMS = {
    "car": plants.car,
    "lq": lambda: plants.lq(N=5),
    "double_integrator": lambda: plants.double_integrator(N=5),
    "unicycle": lambda: plants.unicycle(N=5),
}
LINEAR = ["lq", "double_integrator"]


@cache
def upper_map(name: str) -> UpperMap:
    """At the solution to the last digits."""
    network = synthesize(decompose(PROBLEMS[name](), switch("S14")))
    designed = design(network, preconditioner=PreconditionerKind.MULTILEVEL)
    newton = TwoLevels(designed.network, upper=NewtonCoordinator())
    run = newton.run(designed.state, tolerance=1e-13)
    assert run.settled.all()
    return UpperMap(network=designed.network, settled=run.states[0])


def plain_map(name: str) -> UpperMap:
    """Of the plain Lagrangian, rho = 0, at the same solution."""
    network = upper_map(name).network
    return replace(upper_map(name), network=apply_gains(network, manual_gains(network)))


def observed(upper: UpperMap, gains: Gradient, size: float) -> np.ndarray:
    """What one outer iteration makes of an error in each t and beta: central differences."""
    place = np.flatnonzero(upper.network.of_population(*COORDINATION))
    moves = np.zeros((2, len(place), len(upper.settled)))
    moves[0, np.arange(len(place)), place] = size
    moves[1] = -moves[0]
    starts = (upper.settled + moves).reshape(-1, len(upper.settled))
    ends = TwoLevels(upper.network, upper=gains).step(starts)
    up, down = ends[:, place].reshape(2, len(place), len(place))
    return (up - down).T / (2 * size)


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("name", "size", "rtol"),
    [*((name, 1.0, 1e-9) for name in LINEAR), ("car", 1e-5, 1e-6), ("unicycle", 1e-5, 1e-6)],
)
def test_it_is_what_an_outer_iteration_does(name, size, rtol):
    """Exactly so where the problem is linear, whatever the size of the error."""
    upper, gains = upper_map(name), Gradient(lambda_t=0.3, lambda_beta=0.7)
    found = observed(upper, gains, size)
    is_t = upper.network.of_population("t")[upper.network.of_population(*COORDINATION)]
    expected = np.eye(len(is_t)) + np.where(is_t, 0.3, 0.7)[:, None] * upper.schur
    np.testing.assert_allclose(found, expected, atol=rtol * np.abs(expected).max())
    radius = np.abs(np.linalg.eigvals(found)).max()
    np.testing.assert_allclose(upper.radius(0.3, 0.7), radius, rtol=1e2 * rtol)


def test_the_error_dies_out_at_the_radius():
    """Power iteration: |e| shrinks by the radius an iteration, on average over many."""
    network = synthesize(decompose(PROBLEMS["double_integrator"](), switch("S14")))
    designed = design(network, gain_rule=MULTILEVEL_RULE)
    upper = UpperMap(
        network=designed.network, settled=equilibrium(designed.network, designed.state)
    )
    best = upper.best()
    layer = TwoLevels(
        upper.network, upper=Gradient(lambda_t=best.lambda_t, lambda_beta=best.lambda_beta)
    )
    x = upper.settled + np.random.default_rng(0).standard_normal(len(upper.settled))
    theta = layer.run(x, settled=upper.settled, tolerance=0.0, limit=150).lyapunov.theta[:, 0]
    rate = (theta[150] / theta[50]) ** (1 / 200)  # Theta is the square of |e|
    np.testing.assert_allclose(1 - rate, 1 - best.radius, rtol=0.02)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", PROBLEMS)
def test_no_gains_of_a_grid_are_better_than_the_best(name):
    upper = upper_map(name)
    best = upper.best()
    assert best.radius < 1
    np.testing.assert_allclose(upper.radius(best.lambda_t, best.lambda_beta), best.radius)
    grid = np.logspace(-3, 2, 16)
    assert best.radius <= min(upper.radius(a, b) for a in grid for b in grid)


def test_nor_for_the_plain_double_integrator():
    upper = plain_map("double_integrator")
    assert upper.best().radius <= upper.radius(0.01, 0.01) < 1


def test_the_iterations_that_a_radius_takes():
    halving = UpperGains(lambda_t=1.0, lambda_beta=1.0, radius=0.5)
    np.testing.assert_allclose(halving.predicted(2.0**-20), 20.0)
    repelling = UpperGains(lambda_t=1.0, lambda_beta=1.0, radius=1.0)
    assert repelling.predicted() == float("inf")


# ---- the plain Lagrangian ----------------------------------------------------------------------


def test_the_plain_car_repels():
    """An eigenvalue s of S with positive real part: |1 + lambda s| > 1 for every lambda > 0."""
    upper = plain_map("car")
    assert np.linalg.eigvals(upper.schur).real.max() > 0.01
    assert np.linalg.eigvals(upper_map("car").schur).real.max() < -0.01
    assert all(upper.radius(gain, gain) > 1 for gain in np.logspace(-6, 2, 17))
    assert upper.best().predicted() > 10_000  # two gains hardly help


def test_a_convex_problem_attracts_without_rho():
    upper = plain_map("lq")
    assert np.linalg.eigvals(upper.schur).real.max() < 0
    assert upper.best().radius < 0.99


# ---- closing A ---------------------------------------------------------------------------------

ADVICE = (
    r"cell 0 has more equations than unknowns: close the chain with Form\(start_is_neuron=True\)"
)


@pytest.mark.parametrize(
    "name",
    [
        "car",
        "double_integrator",
        "lq_stable",
    ],
)
def test_a_given_start_has_no_lower_level(name):
    network = small(name)
    with pytest.raises(DesignError, match=ADVICE):
        UpperMap(network=network, settled=network.start_state).best()
