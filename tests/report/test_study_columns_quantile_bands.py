"""Quantiles by groups, beside pandas."""

import numpy as np
import pandas
import pytest
from study_pages import findings

from ann_dc.report.study_columns import band, column_of, is_clustered, strength


def test_a_setting_of_few_values_has_a_band_a_value():
    found = findings(600)
    reported = band(found.columns["problem.N"], found.columns["settling_time"])
    by_value = found.frame.dropna(subset="settling_time").groupby("problem.N")["settling_time"]
    assert [*reported.at] == [10, 30, 100, 300, 1000]
    assert [*reported.counts] == [*by_value.count()]
    for row, share in zip(reported.quantiles, (0.05, 0.25, 0.5, 0.75, 0.95)):
        np.testing.assert_allclose(row, by_value.quantile(share))


def test_many_values_are_cut_into_groups_of_as_many_points():
    found = findings(2000)
    reported = band(found.columns["gains.tau.u"], found.columns["wall_time"])
    assert len(reported.at) == 30
    assert reported.counts.sum() == 2000
    assert np.ptp(reported.counts) <= 2
    assert (np.diff(reported.at) > 0).all()


def test_few_points_have_no_band():
    found = findings(30)
    assert band(found.columns["gains.tau.u"], found.columns["wall_time"]) is None


def test_boxes_by_word():
    found = findings(500)
    setting = found.columns["coordinators"]
    reported = band(setting, found.columns["wall_time"])
    medians = found.frame.groupby("coordinators")["wall_time"].median()
    names = [setting.words[code] for code in reported.at]
    expected = [medians[name == "true"] for name in names]
    np.testing.assert_allclose(reported.quantiles[2], expected)


def test_strength_tells_what_depends_from_what_does_not():
    x = pandas.Series(np.tile(np.arange(10.0), 100))
    noise = pandas.Series(np.random.default_rng(0).normal(size=1000))
    setting = column_of("x", x)
    assert strength(setting, column_of("y", (x - 4.5) ** 2)) == pytest.approx(1)
    assert strength(setting, column_of("y", noise)) < 0.05
    assert strength(setting, column_of("y", pandas.Series(np.ones(1000)))) == 0


@pytest.mark.parametrize("count", [5, 12, 60, 1000])
def test_two_clusters_are_told_from_one(count):
    draw = np.random.default_rng(count)
    one = draw.normal(0, 1, (200, count))
    two = one + np.where(np.arange(count) % 2 == 0, 30.0, 0.0)
    assert np.mean([is_clustered(row) for row in one]) < 0.02
    assert all(is_clustered(row) for row in two)
    assert not is_clustered(np.ones(count))
