"""A run of the two levels: outer iterations counted, and how each sample ended."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from ann_dc.two_level.layer import TwoLevelRun


def counted(residuals, tolerance=1e-6) -> np.ndarray:
    residuals = np.array(residuals, float)
    count = len(residuals) - 1
    return TwoLevelRun(
        states=np.zeros((residuals.shape[1], 1)),
        residuals=residuals,
        gains=np.full((count, 2, residuals.shape[1]), np.nan),
        inner=np.zeros(count + 1, int),
        lyapunov=None,
        tolerance=tolerance,
    ).outer_iterations


def test_outer_iterations_are_a_last_exit():
    dip, rise, still, lost = [1, 1e-9, 1, 1e-9], [1e-9, 1e-9, 1, 1], [1e-9] * 4, [1, np.nan, 1, 1]
    found = counted(np.transpose([dip, rise, still, lost, [1, np.inf, 1e-9, 1e-9]]))
    assert found.tolist() == [3, -1, 0, -1, 2]


@given(
    arrays(float, st.tuples(st.integers(1, 8), st.integers(1, 3)), elements=st.floats(0, 1)),
    st.floats(0.01, 0.99),
)
def test_residuals_stay_below_the_tolerance_from_then_on(residuals, tolerance):
    for count, history in zip(counted(residuals, tolerance), residuals.T):
        below = history < tolerance
        if count < 0:
            assert not below[-1]
        else:
            assert below[count:].all()
            assert count == 0 or not below[count - 1]
