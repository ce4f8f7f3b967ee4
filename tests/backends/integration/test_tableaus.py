"""Tableaus: the same numbers as SciPy's, and the conditions of their order."""

import numpy as np
import pytest
from scipy.integrate import DOP853

from ann_dc.backends.integration import DOP853_TABLEAU, TSIT5_TABLEAU, Rows


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


def test_rows_are_the_tableau_without_its_zeros():
    rows = Rows.of(TSIT5_TABLEAU)
    table = [*TSIT5_TABLEAU.a[1:], TSIT5_TABLEAU.b, TSIT5_TABLEAU.error, TSIT5_TABLEAU.third]
    for row, start, end in zip(table, rows.starts, rows.starts[1:]):
        found = np.zeros_like(row)
        found[rows.which[start:end]] = rows.weights[start:end]
        assert np.array_equal(found, row)
