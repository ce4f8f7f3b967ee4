"""Which figures are chosen, and that plotly knows every word of them."""

import json

import numpy as np
import pandas
import plotly.graph_objects
import pytest
from study_pages import HOSTILE, IDENTITY, findings, frame, hostile

from ann_dc.report.statistics import Findings
from ann_dc.report.study_page.choice import chosen

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


@pytest.mark.sampled(2)
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
        "predicted_settling_time against settling_time",
        "Distribution of settling_time",
        "residuals over time",
    ):
        assert title in titles
    assert "settling_time over nonideal.mismatch" in left_out
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
    dots = [t for t in figure.traces if t["mode"] == "markers" and t["x"] != [None]]
    count = findings(9000).frame["settling_time"].count()
    assert f"{count:,} points, " in figure.says
    assert 2000 <= sum(len(trace["x"]) for trace in dots) <= 2002
    medians = [trace for trace in figure.traces if trace["mode"] == "lines+markers"]
    names = {f"{backend}, {word}" for backend in ("ode", "recurrent") for word in ("true", "false")}
    assert {trace["name"] for trace in medians} == names
    assert sum(sum(trace["customdata"]) for trace in medians) == count
    colours = {trace["line"]["color"] for trace in medians}
    assert len(colours) == 4
    assert {trace["marker"]["color"] for trace in dots} == colours


def test_outcomes_have_a_symbol_each_settled_first():
    figures, _ = chosen(findings(9000))
    (figure,) = [f for f in figures if f.title == "wall_time over problem.N"]
    markers = [trace for trace in figure.traces if trace["mode"] == "markers"]
    legend = {t["name"]: t["marker"]["symbol"] for t in markers if t["x"] == [None]}
    assert list(legend.items()) == [
        ("settled", "circle"), ("diverged", "x"), ("failed", "diamond"),
    ]  # fmt: skip
    drawn = {(t["name"], t["marker"]["symbol"]) for t in markers if t["x"] != [None]}
    assert drawn == set(legend.items())


def test_no_word_of_a_store_is_markup_for_plotly():
    figures, _ = chosen(hostile())
    text = json.dumps([figure.content() for figure in figures])
    assert "&lt;img" in text
    assert "<img" not in text
    assert HOSTILE in figures[0].title or any(HOSTILE in figure.title for figure in figures)


def clusters(*, kinds=("slow", "fast"), within=False):
    """Twelve samples at each of three values and two words, which differ by a factor of ten."""
    draw = np.random.default_rng(0)
    x, word = (column.ravel() for column in np.meshgrid(np.repeat([1.0, 2.0, 3.0], 12), kinds))
    scale = np.where(word == kinds[0], 10.0, 1.0)
    if within:  # of every word, half of the samples
        scale = np.where(np.arange(len(x)) % 2 == 0, 10.0, 1.0)
    noise = draw.uniform(0.9, 1.1, len(x))
    table = pandas.DataFrame({"point": range(len(x)), "rho": x, "kind": word})
    return with_frame(table.assign(settling_time=scale * x * noise), spec={})


def over_rho(found):
    (figure,) = [one for one in chosen(found)[0] if one.title == "settling_time over rho"]
    return figure, [trace for trace in figure.traces if trace["mode"] == "lines+markers"]


def test_median_lines_of_two_words_pass_where_points_are():
    found = clusters()
    _, lines = over_rho(found)
    assert sorted(line["name"] for line in lines) == ["fast", "slow"]
    for line in lines:
        points = found.frame[found.frame["kind"] == line["name"]].groupby("rho")["settling_time"]
        np.testing.assert_allclose(line["y"], points.median(), rtol=1e-4)


def test_median_line_of_samples_in_two_clusters_has_gaps():
    figure, lines = over_rho(clusters(within=True))
    assert [line["y"] for line in lines] == [[None] * 3] * 2
    assert "No median if points form two clusters" in figure.says
    assert sum(trace.get("fill") == "tonexty" for trace in figure.traces) == 2


def test_combinations_of_too_many_words_have_no_line():
    found = clusters()
    words = [f"part {number % 9}" for number in range(len(found.frame))]
    figure, lines = over_rho(with_frame(found.frame.assign(part=words), spec={}))
    assert lines == []
    assert "No lines: too many combinations of other settings" in figure.says


def test_boxes_and_maps_show_no_median_between_two_clusters():
    found = clusters(within=True)
    (by_word,) = [one for one in chosen(found)[0] if one.title == "settling_time by kind"]
    assert {trace["type"] for trace in by_word.traces} == {"scatter"}
    table = clusters().frame.assign(tau=np.tile([1.0, 2.0, 3.0], 24))
    figures, _ = chosen(with_frame(table, spec={}))
    assert not [one for one in figures if one.traces[0]["type"] == "heatmap"]
