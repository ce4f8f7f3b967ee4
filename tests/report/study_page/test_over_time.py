"""Trajectories on the page of a study: a colour and a median for each category."""

import numpy as np
import pandas as pd

from ann_dc.report.statistics import Findings
from ann_dc.report.study_page.over_time import COLOURS, categories_of, over_time

TIME = np.linspace(0.0, 10.0, 51)


def findings(rates, methods):
    curves = {
        point: {"residual_time": TIME, "residuals": np.exp(-rate * TIME)[:, None] * [1.0, 0.5]}
        for point, rate in enumerate(rates)
    }
    frame = pd.DataFrame(
        {"point": range(len(rates)), "seed": 0, "run.method": methods, "outcome": "settled"}
    )
    identity = {"title": "", "vary": {"run.method": []}, "settings": {"run.method": {}}}
    return Findings(place="here", identity=identity, frame=frame, curves=curves)


def test_every_category_has_its_median_and_colour():
    found = findings([1.0, 1.1, 1.2, 2.0, 2.1, 2.2], 3 * ["RK45"] + 3 * ["BDF"])
    categories = {part.label: part for part in categories_of(found, "residuals")}
    for name, rate in (("RK45", 1.1), ("BDF", 2.1)):
        part = categories[name]
        np.testing.assert_allclose(part.median, np.exp(-rate * part.times), rtol=1e-6)
    [figure] = over_time(found)
    thick = [trace for trace in figure.traces if trace["line"]["width"] > 2]
    assert {trace["line"]["color"] for trace in thick} == {*COLOURS[:2]}
    assert "Thick: median" in figure.says


def test_no_median_goes_through_two_clusters():
    [part] = categories_of(findings(4 * [1.0] + 4 * [3.0], 8 * ["RK45"]), "residuals")
    assert np.isnan(part.median[part.times > 1]).all()


def test_a_median_ends_where_half_of_the_runs_have():
    found = findings([1.0, 1.01, 1.02], 3 * ["RK45"])
    for name in ("residual_time", "residuals"):
        found.curves[0][name] = found.curves[0][name][:6]
        found.curves[1][name] = found.curves[1][name][:11]
    [part] = categories_of(found, "residuals")
    assert part.times[-1] == 2.0


def test_two_curves_have_no_median():
    [part] = categories_of(findings([1.0, 1.1], 2 * ["RK45"]), "residuals")
    assert not len(part.median)
