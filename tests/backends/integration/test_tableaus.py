"""Tableaus: the same numbers as SciPy's, and the conditions of their order."""

import numpy as np
import pytest
from scipy.integrate import DOP853
from scipy.integrate._ivp.rk import Dop853DenseOutput

from ann_dc.backends.integration.tableaus import DOP853_TABLEAU, TSIT5_TABLEAU, Rows


def test_the_coefficients_are_those_of_scipy():
    stages = len(DOP853_TABLEAU.b)
    assert np.array_equal(DOP853_TABLEAU.a, DOP853.A[:stages, :stages])
    assert np.array_equal(DOP853_TABLEAU.b, DOP853.B)
    assert np.array_equal(DOP853_TABLEAU.error, DOP853.E5)
    assert np.array_equal(DOP853_TABLEAU.third, DOP853.E3)


@pytest.mark.parametrize(("tableau", "order"), [(DOP853_TABLEAU, 8), (TSIT5_TABLEAU, 5)])
def test_bushy_trees_have_their_weights(tableau, order):
    r"""sum b_i c_i^(q-1) = 1/q up to the order, and no estimate of a polynomial's error."""
    c = tableau.a.sum(axis=1)
    for q in range(1, order + 1):
        assert tableau.b @ c ** (q - 1) == pytest.approx(1 / q, abs=1e-13)
    assert tableau.error @ [*np.ones_like(c), 1.0] == pytest.approx(0.0, abs=1e-13)
    assert not np.triu(tableau.a).any()


@pytest.mark.parametrize(("tableau", "order"), [(DOP853_TABLEAU, 7), (TSIT5_TABLEAU, 4)])
@pytest.mark.parametrize("theta", [0.1, 0.5, 0.77, 1.0])
def test_extension_inside_a_step_meets_the_conditions_of_its_order(tableau, order, theta):
    r"""sum b_i c_i^(q-1) = theta^q / q up to the order, and sum b_i a_ij c_j^p; not beyond."""
    stages, size = len(tableau.b), tableau.between.shape[1]
    a = np.zeros((size, size))
    a[:stages, :stages], a[stages, :stages], a[stages + 1 :] = tableau.a, tableau.b, tableau.extra
    c, b = a.sum(axis=1), theta ** np.arange(1, len(tableau.between) + 1) @ tableau.between
    for q in range(1, order + 1):
        assert b @ c ** (q - 1) == pytest.approx(theta**q / q, abs=1e-12)
    for p in range(1, order - 1):
        expected = theta ** (p + 2) / ((p + 1) * (p + 2))
        assert b @ a @ c**p == pytest.approx(expected, abs=1e-12)
    if theta < 1.0:
        assert abs(b @ c**order - theta ** (order + 1) / (order + 1)) > 1e-7
    else:
        np.testing.assert_allclose(b[:stages], tableau.b, atol=1e-12)


def test_extension_of_dop853_is_that_of_scipy():
    np.testing.assert_array_equal(DOP853_TABLEAU.extra, DOP853.A_EXTRA)
    rng = np.random.default_rng(0)
    K, x, h = rng.standard_normal((16, 2)), rng.standard_normal(2), 0.3
    new = x + h * DOP853_TABLEAU.b @ K[:12]
    F = np.stack([new - x, h * K[0] - (new - x), 2 * (new - x) - h * (K[12] + K[0])])
    theirs = Dop853DenseOutput(0.0, h, x, np.concatenate([F, h * DOP853.D @ K]))
    for theta in (0.2, 0.9):
        b = theta ** np.arange(1, 8) @ DOP853_TABLEAU.between
        np.testing.assert_allclose(x + h * b @ K, theirs(theta * h), rtol=1e-10)


def test_rows_are_the_tableau_without_its_zeros():
    rows = Rows.of(TSIT5_TABLEAU)
    table = [*TSIT5_TABLEAU.a[1:], TSIT5_TABLEAU.b, TSIT5_TABLEAU.error, TSIT5_TABLEAU.third]
    for row, start, end in zip(table, rows.starts, rows.starts[1:]):
        found = np.zeros_like(row)
        found[rows.which[start:end]] = rows.weights[start:end]
        assert np.array_equal(found, row)
