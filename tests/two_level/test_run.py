"""A run of the two levels: outer iterations counted, and how each sample ended."""

import numpy as np
from hypothesis import given, strategies as st
from hypothesis.extra.numpy import arrays

from ann_dc.backends.status import Outcome
from ann_dc.two_level.run import TwoLevelRun


def ended(residuals, tolerance=1e-6) -> TwoLevelRun:
    """A run with these residuals (J + 1, B)."""
    residuals = np.array(residuals, float)
    count = len(residuals) - 1
    return TwoLevelRun(
        states=np.zeros((residuals.shape[1], 1)),
        residuals=residuals,
        gains=np.full((count, 2, residuals.shape[1]), np.nan),
        inner=np.zeros(count + 1, int),
        distances=None,
        tolerance=tolerance,
    )


def test_outer_iterations_are_a_last_exit():
    dip, rise, still, lost = [1, 1e-9, 1, 1e-9], [1e-9, 1e-9, 1, 1], [1e-9] * 4, [1, np.nan, 1, 1]
    found = ended(np.transpose([dip, rise, still, lost, [1, np.inf, 1e-9, 1e-9]])).outer_iterations
    assert found.tolist() == [3, -1, 0, -1, 2]


@given(
    arrays(float, st.tuples(st.integers(1, 8), st.integers(1, 3)), elements=st.floats(0, 1)),
    st.floats(0.01, 0.99),
)
def test_residuals_stay_below_the_tolerance_from_then_on(residuals, tolerance):
    counts = ended(residuals, tolerance).outer_iterations
    for count, history in zip(counts, residuals.T):
        below = history < tolerance
        if count < 0:
            assert not below[-1]
        else:
            assert below[count:].all()
            assert count == 0 or not below[count - 1]


def test_how_each_sample_ended():
    run = ended([[1.0, 1.0, 1.0], [1e-9, 0.5, np.inf]])
    assert run.outcomes == (Outcome.SETTLED, Outcome.NOT_SETTLED, Outcome.DIVERGED)
    assert run.settled.tolist() == [True, False, False]
    assert [run.message(sample) for sample in range(3)] == [
        "settled after 1 outer iteration: KKT residual 1.0e-09",
        "not settled after 1 outer iteration: KKT residual 5.0e-01",
        "diverged: the numbers overflowed in outer iteration 1",
    ]
