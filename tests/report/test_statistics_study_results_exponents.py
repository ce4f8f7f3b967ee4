"""Exponents of known laws."""

import numpy as np
import pandas
import pytest
from scipy.stats import linregress
from study_pages import EXPONENT, findings

from ann_dc.report.statistics import fit
from ann_dc.report.study_columns import column_of


def test_exponent_of_a_known_law_is_found_and_wall_time_is_not_listed():
    found = findings(2000)
    reported = {(one.metric.name, one.setting.name): one for one in found.exponents}
    law = fit(found.columns["wall_time"], found.columns["problem.N"]).exponent
    assert law.low < EXPONENT < law.high
    assert law.high - law.low < 0.01
    assert law.r_squared > 0.99
    assert "wall_time" not in {metric for metric, _ in reported}
    assert {setting for _, setting in reported} == {"problem.N", "gains.tau.u"}
    flat = reported["settling_time", "problem.N"].exponent
    assert flat.low < 0 < flat.high


def test_the_interval_holds_the_exponent_in_95_of_100_studies():
    draw, held = np.random.default_rng(1), 0
    for _ in range(400):
        x = np.repeat([1.0, 10.0, 100.0], 3)
        y = x**0.7 * draw.lognormal(0, 0.3, len(x))
        law = fit(*(column_of("", pandas.Series(values)) for values in (y, x))).exponent
        held += law.low <= 0.7 <= law.high
    assert 365 <= held <= 395


@pytest.mark.parametrize(
    "metric", [[1.0, 1.0, 1.0], [-1.0, 2.0, 3.0], [np.nan] * 3, [0.0, 0.0, 1.0]]
)
def test_no_law_of_what_is_constant_missing_or_not_positive(metric):
    setting = column_of("N", pandas.Series([1.0, 10.0, 100.0]))
    assert fit(column_of("x", pandas.Series(metric)), setting) is None


def test_without_scatter_the_interval_is_a_point():
    x = pandas.Series([1.0, 10.0, 100.0, 1000.0])
    law = fit(column_of("y", 3 * x**2), column_of("x", x)).exponent
    assert (law.value, law.low, law.high) == pytest.approx((2, 2, 2))
    assert linregress(np.log(x), np.log(3 * x**2)).slope == pytest.approx(law.value)
