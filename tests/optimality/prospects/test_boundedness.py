"""Costs with and without a minimum."""

import numpy as np
import pytest
import sympy as sp
from hopeless import UNBOUNDED
from problems import SUITE

from ann_dc.optimality import feasible_path, without_minimum
from ann_dc.problem import OptimalControlProblem, straight_line


def descended(problem):
    line = straight_line(problem)
    return without_minimum(problem, feasible_path(problem, line.q, line.u))


@pytest.mark.parametrize("name", UNBOUNDED)
def test_a_cost_without_a_minimum(name):
    found = descended(UNBOUNDED[name])
    assert found is not None
    assert found.objective < -1e9
    assert found.largest in found.message


@pytest.mark.parametrize("name", ["car", "pendulum_state_cost", "cstr", "lq_stable", "van_der_pol"])
def test_a_cost_with_a_minimum(name):
    assert descended(SUITE[name].problem) is None


@pytest.mark.parametrize("size", [1.0, 1e6])
def test_an_offset_is_no_descent(size):
    x, a = sp.symbols("x a")
    problem = OptimalControlProblem(
        states=(x,),
        controls=(a,),
        dynamics=(a,),
        cost=size * (a**2 + x**2 - 1e12),
        horizon=5,
        q_0=(1,),
    )
    assert descended(problem) is None


def test_it_is_told_in_the_users_units():
    x, a = sp.symbols("x a")
    problem = OptimalControlProblem(
        states=(x,),
        controls=(a,),
        dynamics=(a,),
        cost=-(a**2),
        horizon=5,
        q_0=(1,),
        units={"cost": "J"},
    )
    found = descended(problem)
    assert found is not None
    assert np.isfinite(found.objective)
    assert f"{found.objective:.3g} J while a grew" in found.message
