"""Outcomes by cause, and points that stand out."""

import numpy as np
import pandas
from study_pages import IDENTITY, findings

from ann_dc.report.statistics import STANDING_OUT, Findings, outliers_of


def test_messages_that_differ_in_numbers_are_one_cause():
    found = findings(2000)
    reported = {cause.outcome: cause for cause in found.causes}
    counts = found.frame["outcome"].value_counts()
    assert {name: cause.points for name, cause in reported.items()} == counts.to_dict()
    example = reported["diverged"]
    assert found.frame["outcome"][example.row] == "diverged"
    assert found.frame["message"][example.row] == example.message


def test_what_fails_for_two_reasons_is_two_causes_and_rare_ones_are_counted_together():
    messages = ["no gains"] * 3 + [f"reason {chr(97 + n)}" for n in range(20)]
    frame = pandas.DataFrame({"point": range(23), "outcome": "failed", "message": messages})
    reported = Findings(place="out", identity=IDENTITY, frame=frame).causes
    assert reported[0].message == "no gains"
    assert sum(cause.points for cause in reported) == 23
    assert reported[-1].outcome == "7 further causes"
    assert reported[-1].points == 7


def test_the_slowest_and_the_worst_come_first():
    found = findings(300)
    seconds = found.frame["wall_time"]
    slowest, limited = found.outliers[:2]
    assert slowest.title == "Slowest"
    assert [*slowest.rows] == [*seconds.nlargest(STANDING_OUT).index]
    settling = found.frame["settling_time"]
    assert [*settling[limited.rows]] == [*settling.nlargest(STANDING_OUT)]
    every = outliers_of("all", found.columns["settling_time"], 400).rows
    assert len(every) == settling.count()
    assert np.isfinite(settling[every]).all()
