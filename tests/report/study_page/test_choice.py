"""Which figures are chosen, and that plotly knows every word of them."""

import json

import numpy as np
import pandas
import plotly.graph_objects
import pytest
from study_pages import HOSTILE, IDENTITY, findings, frame, hostile

from ann_dc.report.findings import Findings
from ann_dc.report.study_page import chosen

DOZEN = 12


def with_frame(table, **changed):
    return Findings(place="out", identity=IDENTITY | changed, frame=table)


def grid():
    """A point at every pair of two settings."""
    rho, tau = np.meshgrid(10.0 ** np.arange(-2, 3), np.linspace(1, 2, 7))
    table = pandas.DataFrame({"point": range(35), "rho": rho.ravel(), "tau": tau.ravel()})
    table["settling_time"] = table["tau"] / table["rho"]
    return table


STUDIES = {
    "many points": lambda: findings(3000),
    "few points": lambda: findings(12),
    "one point": lambda: findings(1),
    "no point": lambda: with_frame(frame(5).iloc[:0]),
    "hostile words": hostile,
    "a grid": lambda: with_frame(grid()),
    "one sweep": lambda: with_frame(grid()[:5]),
    "a metric without values": lambda: with_frame(grid().assign(overshoot=np.nan)),
    "a metric of one value": lambda: with_frame(grid().assign(overshoot=1.0)),
    "infinite values": lambda: with_frame(grid().assign(overshoot=[np.inf, 1, 2, 3, 4] * 7)),
    "a metric of words": lambda: with_frame(grid().assign(overshoot="none")),
}


@pytest.mark.parametrize("made", STUDIES.values(), ids=STUDIES)
def test_plotly_takes_every_figure(made):
    figures, _ = chosen(made())
    assert len(figures) <= DOZEN
    for figure in figures:
        content = figure.content()
        json.dumps(content, allow_nan=False)
        plotly.graph_objects.Figure(content)  # raises at a word that it does not know


def test_the_figures_that_tell_most_are_there_and_the_others_are_named():
    figures, left_out = chosen(findings(2000))
    titles = [figure.title for figure in figures]
    assert len(figures) == DOZEN
    for title in (
        "settling_time over gains.tau.u",
        "Yield over gains.tau.u",
        "predicted_settling_time beside settling_time",
        "How settling_time spreads",
        "residuals over time",
    ):
        assert title in titles
    assert "settling_time over defect.mismatch and input.q_d.x" in left_out
    assert not {title.lower() for title in titles} & {name.lower() for name in left_out}


def test_a_map_has_the_medians_of_its_cells():
    figures, _ = chosen(with_frame(grid(), spec={}))
    (figure,) = [figure for figure in figures if figure.traces[0]["type"] == "heatmap"]
    trace = figure.traces[0]
    table = grid().pivot(index="tau", columns="rho", values="settling_time")
    if figure.layout["xaxis"]["title"]["text"] == "tau":
        table = table.T
    np.testing.assert_allclose(trace["z"], np.log10(table.to_numpy()), rtol=1e-4, atol=1e-4)
    assert len(trace["x"]) == table.shape[1] + 1, "edges of the cells"
    assert min(*trace["x"], *trace["y"]) > 0


def test_points_are_drawn_in_part_but_counted_whole():
    figures, _ = chosen(findings(9000, spec={"settling_time": 30.0}))
    (figure,) = [f for f in figures if f.title == "settling_time over gains.tau.u"]
    dots = [trace for trace in figure.traces if trace["mode"] == "markers"]
    count = findings(9000).frame["settling_time"].count()
    assert f"{count:,} points, " in figure.says
    assert 2000 <= sum(len(trace["x"]) for trace in dots) <= 2002
    (median,) = [trace for trace in figure.traces if trace.get("name") == "median"]
    assert sum(median["customdata"]) == count


def test_no_word_of_a_store_is_markup_for_plotly():
    figures, _ = chosen(hostile())
    text = json.dumps([figure.content() for figure in figures])
    assert "&lt;img" in text
    assert "<img" not in text
    assert HOSTILE in figures[0].title or any(HOSTILE in figure.title for figure in figures)
