"""The interior point against IPOPT: what it finds is an optimum there too."""

from dataclasses import replace

import numpy as np
import pytest
import sympy as sp
from constrained import CONSTRAINED
from problems import SUITE

from ann_dc.optimality.certificate import certify
from ann_dc.optimality.interior_point import interior_point
from ann_dc.optimality.reference_solvers import ipopt_point
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.progress import Stopped

PROBLEMS = {**SUITE, **CONSTRAINED}

x, v, a, b = sp.symbols("x v a b")


def assert_optimal(problem, found):
    """IPOPT stays where the search ended, or leaves it for a dearer optimum."""
    assert found.converged, found.reason
    reference = ipopt_point(problem, found.q, found.u)
    assert reference is not None
    if found.objective < reference.objective * (1 - 1e-6):
        beta = np.zeros_like(found.mu)
        beta[:, 1:] = -found.mu[:, :-1]
        point = found.q[:, :-1], found.u, found.q[:, 1:], found.mu, beta, found.zeta, found.zeta_end
        assert certify(problem, *point).certified
        return
    q = np.column_stack([reference.q, reference.t[:, -1]])
    np.testing.assert_allclose(found.q, q, atol=1e-4 * np.abs(q).max())
    u_size = np.abs(reference.u).max()
    np.testing.assert_allclose(found.u, reference.u, atol=1e-4 * u_size)


@pytest.mark.sampled(4)
@pytest.mark.parametrize("name", PROBLEMS)
def test_interior_point_ends_at_an_optimum_of_ipopt(name):
    problem = PROBLEMS[name].problem
    assert_optimal(problem, interior_point(problem))


def test_soft_rows_below_at_and_beyond_their_price_are_weighed():
    base = OptimalControlProblem(
        states=(x, v), controls=(a,), dynamics=(v, a), dt=0.1, horizon=20, cost=a**2 / 2,
        q_0=(0, 0), q_d=(1, 0), constraints={"pace": v <= 0.5}, soft={"pace": 1.0},
    )  # fmt: skip
    for soft in (0.1, 1.0, 1e3):
        problem = replace(base, soft={"pace": soft})
        assert_optimal(problem, interior_point(problem))


def test_search_from_a_saddle_ends_at_a_minimum():
    saddle = OptimalControlProblem(
        states=(x,), controls=(a,), map=(x + a,), horizon=1, cost=a**2 / 2,
        terminal_cost=x**4 / 4 - x**2, q_0=(0,), q_d=None,
    )  # fmt: skip
    found = interior_point(saddle)
    assert abs(abs(found.u[0, 0]) - 1.0) < 1e-6  # u + u^3 - 2 u = 0
    assert found.objective < -0.24


def test_search_stops_when_its_progress_raises():
    def stop(line):
        raise Stopped("enough")

    with pytest.raises(Stopped, match="enough"):
        interior_point(PROBLEMS["car"].problem, progress=stop)


def test_search_from_a_cost_without_a_value_says_so():
    problem = OptimalControlProblem(
        states=(x,), controls=(a,), map=(x - a,), horizon=3, cost=sp.log(a), q_0=(1,), q_d=None
    )
    found = interior_point(problem, np.ones((1, 4)), -np.ones((1, 3)))
    assert not found.converged
    assert "no finite value" in found.reason
