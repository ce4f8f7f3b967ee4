"""Yield: shares with the interval of Clopper and Pearson."""

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy.stats import beta

from ann_dc.errors import StudyError
from ann_dc.yields import Yield, ends_of, within


@given(st.integers(1, 3000), st.data())
def test_the_interval_is_that_of_the_beta_distribution(count, data):
    passed = data.draw(st.integers(0, count))
    found = Yield(passed=passed, count=count)
    low = beta.ppf(0.025, passed, count - passed + 1) if passed else 0.0
    high = beta.ppf(0.975, passed + 1, count - passed) if passed < count else 1.0
    assert found.low == pytest.approx(low, abs=1e-9)
    assert found.high == pytest.approx(high, abs=1e-9)
    assert found.low <= found.share <= found.high


def test_of_nothing_anything_may_be():
    found = Yield(passed=0, count=0)
    assert found.interval == (0.0, 1.0)
    with pytest.raises(StudyError, match="passed"):
        Yield(passed=3, count=2)


@pytest.mark.parametrize("limit", [(1.0,), "high", (3.0, 2.0), True, float("nan")])
def test_limits_that_are_none(limit):
    with pytest.raises(StudyError, match="limit"):
        ends_of(limit)


def test_interval_of_samples_that_share_draws_is_that_of_the_draws():
    """A draw counts once, under one setting or under three that agree."""
    once, thrice = Yield(passed=18, count=20), Yield(passed=54, count=60, draws=20)
    assert thrice.interval == pytest.approx(once.interval)
    assert Yield(passed=54, count=60).low > thrice.low
    none = Yield(passed=5, count=5, draws=0)
    assert np.isnan(none.interval).all()
    assert str(none) == "100.0 % (5 of 5, no random settings: no interval)"


def test_what_is_missing_keeps_no_limit():
    columns = {"control_error": np.array([0.05, 0.2, np.nan]), "settling_time": np.full(3, 40.0)}
    spec = {"control_error": 0.1, "settling_time": (5.0, None)}
    assert within(columns, spec).tolist() == [True, False, False]
