"""When a network counts as settled: the last exit, found exactly between samples."""

import numpy as np
from hypothesis import given, strategies as st

from ann_dc.backends.settling import last_exit


@given(
    st.lists(st.floats(0.01, 3.0), min_size=3, max_size=30),
    st.floats(0.1, 5.0),
    st.floats(0.01, 0.99),
)
def test_last_exit_of_an_exponential_is_exact(gaps, rate, share):
    time = np.concatenate([[0.0], np.cumsum(gaps)])
    expected = share * time[-1]
    found = last_exit(time, np.exp(-rate * time), np.exp(-rate * expected))
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-12)


@given(st.lists(st.floats(1e-12, 1e3), min_size=1, max_size=30), st.floats(1e-10, 1e2))
def test_last_exit_is_the_last(residuals, tolerance):
    residual = np.array(residuals)
    time = np.arange(len(residual), dtype=float)
    found = last_exit(time, residual, tolerance)
    if residual[-1] >= tolerance:
        assert np.isnan(found)
    else:
        assert (residual[time > found] < tolerance).all()
        before = residual[time <= found]
        assert (before < tolerance).all() or before[-1] >= tolerance
        assert found == 0.0 or not (residual < tolerance).all()


def test_a_dip_is_no_settling():
    residual = np.array([1.0, 1e-9, 1.0, 1e-9, 1e-9])
    assert 2.0 < last_exit(np.arange(5.0), residual, 1e-6) < 3.0


def test_nan_is_not_below_tolerance():
    assert last_exit(np.arange(3.0), np.array([1e-9, np.nan, 1e-9]), 1e-6) == 2.0
    assert np.isnan(last_exit(np.arange(2.0), np.array([1e-9, np.nan]), 1e-6))
