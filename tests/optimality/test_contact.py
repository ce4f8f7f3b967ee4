"""Which rows touch and which pull, in distances that do not depend on how a row was written."""

from dataclasses import replace

import numpy as np
import pytest
import sympy as sp

from ann_dc.optimality.expansion import Expansion
from ann_dc.problem import plants
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.problem.scales import natural_scales

a, b, x = sp.symbols("a b x")

PLAIN = OptimalControlProblem(
    states=(x,), controls=(a, b), map=(x + a + b,), cost=a**2 + b**2, horizon=3, q_0=(0,), q_d=(1,)
)
U = np.array([[0.5, 0.25, 0.0], [0.25, 0.0, 0.0]])
Q = PLAIN.functions.rollout((0.0,), U)
MU = np.array([[-1.0, -1.0, -1.0]])


def contact(zeta=None, zeta_end=None, **changes):
    return Expansion.at(replace(PLAIN, **changes), Q, U, MU, zeta, zeta_end).contact


def test_a_distance_is_told_in_ranges_of_what_a_row_reads():
    """The range of a is a half, that of x is one."""
    found = contact(constraints=(a <= 0.25, x <= 0.25))
    np.testing.assert_allclose(found.distance[:-1, 0], [0.5, 0.0, -0.5])
    np.testing.assert_allclose(found.distance[:-1, 1], [-0.25, 0.5, 0.75])
    assert not found.is_row[-1].any()
    assert found.near[:, 0].tolist() == [True, True, False, False]


@pytest.mark.parametrize("row", [1e6 * (a + x) <= 1e6, (a + x) ** 3 <= 1, sp.exp(a + x) <= sp.E])
def test_a_row_may_be_written_in_any_way(row):
    """To first order about where it touches: distances and multipliers of the row itself."""
    own, other = a + x <= 1, row
    lengths = [float((r.lhs - r.rhs).diff(a).subs({a: 0.25, x: 0.75})) for r in (own, other)]
    zeta = np.array([[0.0, 2.0, 0.0]])
    first = contact(zeta, constraints=(own,))
    second = contact(zeta * lengths[0] / lengths[1], constraints=(other,))
    for name in ("value", "distance", "slope", "multiplier", "product"):
        ours, theirs = getattr(first, name), getattr(second, name)
        np.testing.assert_allclose(theirs[1], ours[1], atol=1e-9)
    assert (first.near == second.near).all()
    assert (first.strong(1.0) == second.strong(1.0)).all()
    assert first.strong(1.0).sum() == 1


def test_only_what_touches_and_pulls_is_strongly_active():
    zeta = np.array([[0.0, 2.0, 2.0], [0.0, 1e-9, 0.0]])
    found = contact(zeta, constraints=(a <= 0.25, b <= 0))
    assert found.near.T.tolist() == [[True, True, False, False], [True, True, True, False]]
    assert found.strong(4.0).T.tolist() == [[False, True, False, False], [False] * 4]
    assert found.product[2, 0] > 0


def test_a_limit_pulls_by_the_slope_against_it():
    """mu = -1 and cost a^2 have the slope 2 a - 1: outward below a half, inward above."""
    found = contact(bounds={a: (None, 0.25), b: (0.0, 3.0)})
    unit = found.multiplier[1, 0] / 0.5
    np.testing.assert_allclose(found.multiplier[:, 0] / unit, [0.0, 0.5, 0.0, 0.0])
    np.testing.assert_allclose(found.multiplier[:, 1], 0.0)  # all push up, away from zero
    np.testing.assert_allclose(found.distance[:-1, 1] * 3, [-0.25, 0.0, 0.0], atol=1e-15)
    assert found.slope[1].tolist() == [[0.0, 1.0, 0.0], [0.0, 0.0, -1.0]]


def test_rows_of_what_an_end_fixes_move_nothing():
    found = contact(constraints=(x >= 0, x + a >= 0.5), terminal_constraints=(x <= 1,))
    assert found.near[0].tolist() == [True, True]
    assert found.slope[0, 0].tolist() == [0.0, 0.0, 0.0]
    assert found.slope[0, 1, 0] == 0.0
    assert found.slope[0, 1, 1] < 0.0
    assert found.near[-1].tolist() == [True, False]
    assert not found.slope[-1].any()


def test_a_row_without_a_slope_is_far_on_either_side():
    found = contact(constraints=(b**2 <= 1, b**2 >= 1, b**2 <= 0))
    assert found.distance[1].tolist() == [-np.inf, np.inf, 0.0]
    assert not found.slope[1].any()


def test_a_problem_without_inequalities_has_none():
    assert contact() is None
    assert contact(bounds={a: (None, None)}) is None
    car = plants.car(N=3)
    assert Expansion.at(car, np.zeros((4, 4)), np.zeros((2, 3)), np.zeros((4, 3))).contact is None


def test_what_a_row_adds_to_slopes_and_curvature():
    zeta = np.array([[0.0, 2.0, 0.0]])
    plain = Expansion.at(PLAIN, Q, U, MU)
    row = replace(PLAIN, constraints=(a**2 + x <= 0.8125,))
    held = Expansion.at(row, Q, U, MU, zeta)
    scales = natural_scales(row)
    factors = np.array([*scales.state_factors, *scales.control_factors])
    added = held.own_slope() - plain.own_slope()
    assert added[[0, 2]].tolist() == np.zeros((2, 3)).tolist()
    np.testing.assert_allclose(added[1], 2 * np.array([1.0, 0.5, 0.0]) * factors / scales.cost)
    np.testing.assert_allclose((held.hessian - plain.hessian)[1, 1, 1], 2 * plain.hessian[1, 1, 1])
    away = Expansion.at(replace(PLAIN, constraints=(a**2 + x <= 0.9,)), Q, U, MU, zeta)
    np.testing.assert_array_equal(away.hessian, plain.hessian)
