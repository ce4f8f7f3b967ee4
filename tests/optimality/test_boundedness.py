"""Costs with and without a minimum."""

from dataclasses import replace

import numpy as np
import pytest
import sympy as sp
from hopeless import UNBOUNDED
from problems import SUITE

from ann_dc.optimality.boundedness import without_minimum
from ann_dc.optimality.feasibility import feasible_path
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.problem.scales import straight_line


def descended(problem):
    line = straight_line(problem)
    return without_minimum(problem, feasible_path(problem, line.q, line.u))


@pytest.mark.parametrize("name", UNBOUNDED)
def test_a_cost_without_a_minimum(name):
    found = descended(UNBOUNDED[name])
    assert found is not None
    assert found.objective < -1e9
    assert found.largest in found.message


@pytest.mark.sampled(2)
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


@pytest.mark.parametrize("catch", ["effort", "share"])
def test_cost_that_falls_by_a_last_control_alone_has_no_minimum(catch):
    """Every other stage resists: a large catch empties the stock, and it explodes."""
    x, a = sp.symbols("x a")
    taken = a if catch == "effort" else a * x
    problem = OptimalControlProblem(
        states=(x,), controls=(a,), dynamics=(x * (1 - x) - taken,), dt=0.05, cost=-taken,
        horizon=40, q_0=(0.8,),
    )  # fmt: skip
    found = descended(problem)
    assert found is not None
    assert found.largest == "a"
    assert descended(replace(problem, bounds={a: (0, 2)})) is None
