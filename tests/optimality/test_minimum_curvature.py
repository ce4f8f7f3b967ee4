"""The smallest eigenvalue has the sign that the stages tell, and is left out where it is long."""

from dataclasses import replace

import numpy as np
import pytest
import sympy as sp
from points import random_point
from problems import SUITE

from ann_dc.optimality import minimum as curvature
from ann_dc.optimality.by_stages import Minimum
from ann_dc.optimality.expansion import Expansion
from ann_dc.optimality.minimum import minimum_of, smallest_curvature
from ann_dc.problem import plants
from ann_dc.problem.declaration import OptimalControlProblem


@pytest.mark.parametrize("name", ["car", "bicycle", "cart_pole"])
def test_its_sign_is_the_second_order(name):
    problem, rng = SUITE[name].problem, np.random.default_rng(0)
    seen = set()
    for pull in (0.001, 0.01, 0.1, 1.0, 10.0):
        point = random_point(problem, rng, spread=0.1, pull=pull)
        least, reported = (
            smallest_curvature(problem, *point),
            minimum_of(Expansion.at(problem, *point)),
        )
        assert reported is (Minimum.STRICT if least > 0 else Minimum.NOT_A_MINIMUM)
        seen.add(reported)
    assert seen


def test_it_is_infinite_where_nothing_is_free_and_none_where_nothing_is_known():
    problem = plants.double_integrator(N=2)
    q, u, mu = np.zeros((2, 3)), np.zeros((1, 2)), np.zeros((2, 2))
    assert smallest_curvature(problem, q, u, mu) == np.inf
    car = plants.car(N=3)
    assert np.isnan(
        smallest_curvature(car, np.full((4, 4), np.inf), np.zeros((2, 3)), np.zeros((4, 3)))
    )


def test_long_rows_leave_it_out(monkeypatch):
    monkeypatch.setattr(curvature, "LARGEST_REDUCED", 3)
    problem = plants.double_integrator(N=4)
    q, u, mu = np.zeros((2, 5)), np.zeros((1, 4)), np.zeros((2, 4))
    assert np.isnan(smallest_curvature(problem, q, u, mu))


def test_rows_that_are_strongly_active_take_their_directions():
    """Cost a^2 - b^2 / 2, one stage: with b held by a row or a limit there is a alone."""
    a, b, x = sp.symbols("a b x")
    problem = OptimalControlProblem(
        states=(x,), controls=(a, b), map=(x + a + b,), cost=a**2 - b**2 / 2, horizon=1, q_0=(0,)
    )
    point = np.array([[0.0, 1.0]]), np.array([[0.0], [1.0]]), np.zeros((1, 1))
    np.testing.assert_allclose(smallest_curvature(problem, *point), -0.5)
    limited = replace(problem, bounds={b: (None, 1)})
    np.testing.assert_allclose(smallest_curvature(limited, *point), 1.0)
    row = replace(problem, constraints=(b <= 1,))
    np.testing.assert_allclose(smallest_curvature(row, *point, np.array([[1.0]])), 1.0)
    np.testing.assert_allclose(smallest_curvature(row, *point), -0.5)  # it touches, and no more
    end = replace(problem, terminal_constraints=(x <= 1,), cost=problem.cost)
    pulled = replace(end, cost=(a - b) ** 2 / 2 + (a + b) ** 2 / 4 - (a + b))
    half = np.array([[0.0, 1.0]]), np.array([[0.5], [0.5]]), np.zeros((1, 1)) + 0.5
    reported = smallest_curvature(pulled, *half, zeta_end=np.array([0.5]))
    np.testing.assert_allclose(reported, 1.0)
