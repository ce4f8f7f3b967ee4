"""Rows are measured on their boundary, against slopes in closed form."""

import numpy as np
import pytest
import sympy as sp

from ann_dc import OptimalControlProblem
from ann_dc.problem.boundary import boundary_slopes

x, y, a = sp.symbols("x y a")


def slopes(rows, end_rows=(), factors=(1.0, 1.0, 1.0), start=(0.0, 0.0)):
    problem = OptimalControlProblem(
        states=(x, y), controls=(a,), map=(x + a, y), cost=a**2, horizon=4,
        q_0=(None, None), q_d=None,
        constraints=rows, terminal_constraints=end_rows,
    )  # fmt: skip
    q = np.array(start)[:, None] + 0.3 * np.arange(5)
    return boundary_slopes(problem.functions, q, np.zeros((1, 4)), np.array(factors))


@pytest.mark.parametrize("start", [(0.0, 0.0), (5.0, 1.0), (1.0, -1.0)])
def test_of_a_disc_its_diameter(start):
    of_stages, of_end = slopes([x**2 + y**2 >= 4], [x**2 + y**2 <= 9], start=start)
    np.testing.assert_allclose(of_stages, [4.0], rtol=1e-9)
    np.testing.assert_allclose(of_end, [6.0], rtol=1e-9)


def test_in_the_scales_given():
    of_stages, _ = slopes([3 * x + 4 * y <= 1, a <= 2 * x], factors=(1.0, 10.0, 100.0))
    np.testing.assert_allclose(of_stages, np.hypot([3, 100], [40, 2]))


def test_a_row_that_is_flat_along_the_path_is_looked_at_from_beside():
    of_stages, of_end = slopes([a**2 * y**2 <= 1])
    np.testing.assert_allclose(of_stages, [8**0.5])
    assert of_end.shape == (0,)


def test_of_a_row_without_a_boundary_it_is_one():
    of_stages, _ = slopes([x**2 + y**2 + 1 >= 0])
    np.testing.assert_array_equal(of_stages, [1.0])
