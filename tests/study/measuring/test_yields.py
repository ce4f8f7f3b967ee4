"""Yield: shares with the interval of Clopper and Pearson."""

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy.stats import beta

from ann_dc.errors import StudyError
from ann_dc.study.measuring import Yield, draws_of, ends_of, within, yield_of


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


def test_what_failed_or_is_missing_does_not_pass():
    spec = {"control_error": 0.1, "settling_time": (5.0, 50.0)}
    good = ("settled", 0.05, 40.0)
    rows = [
        good,
        ("diverged", *good[1:]),
        ("settled", 0.2, 40.0),
        ("settled", np.nan, 40.0),
        ("settled", 0.05, 4.0),
        ("settled", 0.05, 51.0),
        ("failed", np.nan, np.nan),
    ]
    names = ("outcome", "control_error", "settling_time")
    columns = {name: np.array(values) for name, values in zip(names, zip(*rows))}
    assert within(columns, spec).tolist() == [True] + 6 * [False]
    assert yield_of(columns, spec).count == 7
    assert yield_of(columns, {}).passed == 5


@pytest.mark.parametrize("limit", [(1.0,), "high", (3.0, 2.0), True, float("nan")])
def test_limits_that_are_none(limit):
    with pytest.raises(StudyError, match="limit"):
        ends_of(limit)


def test_interval_of_samples_that_share_draws_is_that_of_the_draws():
    """Whether a draw is counted under one setting or under three that agree."""
    once, thrice = Yield(passed=18, count=20), Yield(passed=54, count=60, draws=20)
    assert thrice.interval == pytest.approx(once.interval)
    assert Yield(passed=54, count=60).low > thrice.low
    none = Yield(passed=5, count=5, draws=0)
    assert np.isnan(none.interval).all()
    assert str(none) == "100.0 % (5 of 5, nothing drawn: no interval)"


SEEDS = np.tile([3, 5, 7, 9], 2)
MISMATCH = "defect.mismatch"
SETTINGS = {
    "a defect under two words": ({MISMATCH: [0.01] * 8, "design.kind": [*"aaaabbbb"]}, 4),
    "a defect of size zero": ({MISMATCH: [0.0] * 8, "design.kind": [*"aaaabbbb"]}, 0),
    "sizes zero and one percent": ({MISMATCH: [0.0] * 4 + [0.01] * 4}, 4),
    "places in a range": ({"input.q_d.x": np.arange(8.0)}, 4),
    "tolerances": ({"tolerance.resistor": [0.01] * 8}, 4),
    "random starts": ({"start.spread": [0.1] * 8}, 4),
    "starts on the line": ({"start.kind": ["line"] * 8}, 0),
    "nothing set": ({}, 0),
}


@pytest.mark.parametrize(("settings", "draws"), SETTINGS.values(), ids=SETTINGS)
def test_draws_of_rows_are_their_seeds_where_something_is_drawn(settings, draws):
    columns = {name: np.array(values) for name, values in settings.items()}
    assert draws_of({"seed": SEEDS, **columns}) == draws
    assert draws_of(columns) is None


def test_a_grid_without_draws_has_no_interval():
    assert draws_of({"seed": np.full(3, 5), "gains.rho": np.array([0.3, 1.0, 3.0])}) == 0
