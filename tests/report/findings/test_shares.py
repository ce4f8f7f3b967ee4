"""Shares, their intervals, and what is within a spec."""

import numpy as np
import pytest
from scipy.stats import binomtest
from study_pages import findings

from ann_dc.report.findings import Share, limits, within


@pytest.mark.parametrize(("hits", "of"), [(0, 7), (7, 7), (1, 100), (932, 1000), (99_999, 100_000)])
def test_the_interval_is_that_of_clopper_and_pearson(hits, of):
    told = binomtest(hits, of).proportion_ci(0.95, "exact")
    assert Share(hits, of).interval == pytest.approx((told.low, told.high), rel=1e-6)


def test_what_has_no_value_is_not_within_the_spec():
    found = findings(500, spec={"settling_time": 30.0, "power": [None, 100.0], "missing": 1.0})
    settling, power = (found.frame[name] for name in ("settling_time", "power"))
    assert settling.isna().any()
    spec = limits(found)
    assert [limit.column.name for limit in spec] == ["settling_time", "power"]
    np.testing.assert_array_equal(within(spec), (settling <= 30) & (power <= 100))


def test_a_limit_from_below_and_from_both_sides():
    found = findings(50, spec={"settling_time": [5, None], "overshoot": [0.05, 0.1]})
    low, both = limits(found)
    assert str(low) == "settling_time ≥ 5 us"
    assert str(both) == "overshoot in 0.05 to 0.1"
    np.testing.assert_array_equal(low.met, found.frame["settling_time"] >= 5)
    beyond = np.maximum(0.05 - found.frame["overshoot"], found.frame["overshoot"] - 0.1)
    np.testing.assert_allclose(both.beyond, beyond)
