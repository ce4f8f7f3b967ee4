"""Shares, their intervals, and what is within a spec."""

import numpy as np
from study_pages import findings

from ann_dc.study.yield_metrics import yield_of


def test_what_has_no_value_is_not_within_the_spec():
    found = findings(500, spec={"settling_time": 30.0, "power": [None, 100.0], "missing": 1.0})
    settling, power = (found.frame[name] for name in ("settling_time", "power"))
    assert settling.isna().any()
    spec = found.limits
    assert [limit.column.name for limit in spec] == ["settling_time", "power"]
    settled = found.frame["outcome"] == "settled"
    np.testing.assert_array_equal(found.within, settled & (settling <= 30) & (power <= 100))


def test_a_limit_from_below_and_from_both_sides():
    found = findings(50, spec={"settling_time": [5, None], "overshoot": [0.05, 0.1]})
    low, both = found.limits
    assert str(low) == "settling_time ≥ 5 us"
    assert str(both) == "overshoot in 0.05 to 0.1"
    np.testing.assert_array_equal(low.met, found.frame["settling_time"] >= 5)
    beyond = np.maximum(0.05 - found.frame["overshoot"], found.frame["overshoot"] - 0.1)
    np.testing.assert_allclose(both.beyond, beyond)


def test_true_is_one_in_a_spec():
    found = findings(100, spec={"coordinators": [1, None]})
    (limit,) = found.limits
    np.testing.assert_array_equal(limit.met, found.frame["coordinators"])


def test_a_point_that_did_not_settle_is_not_within_the_spec_whatever_it_measured():
    found = findings(500, spec={"predicted_settling_time": [0.0, None]})
    met = found.limits[0].met
    diverged = (found.frame["outcome"] == "diverged").to_numpy()
    assert met[diverged].all()
    assert not found.within[diverged].any()


def test_yields_of_a_page_are_those_of_the_study():
    found = findings(400)
    columns = {name: found.frame[name].to_numpy() for name in found.frame.columns}
    names, yields = zip(*found.yields)
    assert (names[0], names[-1]) == ("settled", "total")
    assert yields[-1] == yield_of(columns, found.identity["spec"])
    rows = np.arange(7, 150, 3)
    some = {name: cells[rows] for name, cells in columns.items()}
    assert found.yield_among(rows) == yield_of(some, found.identity["spec"])


def test_yields_by_value_are_those_of_the_records_with_the_value():
    found = findings(400)
    by_value = dict(found.yields_by_value)
    names = {name.split(" = ")[0] for name in by_value}
    assert names == {"problem.N", "backend", "coordinators"}
    assert by_value["coordinators = true"] == found.yield_among(
        np.flatnonzero(found.frame["coordinators"])
    )
    for setting in names:
        parts = [one for name, one in by_value.items() if name.startswith(setting)]
        assert sum(one.passed for one in parts) == found.yields[-1][1].passed


def test_study_without_limits_has_no_yields_by_value():
    assert findings(400, spec={}).yields_by_value == []
