"""Outcomes by cause, and points that stand out."""

import numpy as np
import pandas
from study_pages import IDENTITY, findings

from ann_dc.report.failure_causes import causes, slowest, worst
from ann_dc.report.fractions import limits
from ann_dc.report.statistics import Findings


def test_messages_that_differ_in_numbers_are_one_cause():
    found = findings(2000)
    told = {cause.outcome: cause for cause in causes(found)}
    counts = found.frame["outcome"].value_counts()
    assert {name: cause.points for name, cause in told.items()} == counts.to_dict()
    example = told["diverged"]
    assert found.frame["outcome"][example.row] == "diverged"
    assert found.frame["message"][example.row] == example.message


def test_what_fails_for_two_reasons_is_two_causes_and_rare_ones_are_counted_together():
    messages = ["no gains"] * 3 + [f"reason {chr(97 + n)}" for n in range(20)]
    frame = pandas.DataFrame({"point": range(23), "outcome": "failed", "message": messages})
    told = causes(Findings(place="out", identity=IDENTITY, frame=frame))
    assert told[0].message == "no gains"
    assert sum(cause.points for cause in told) == 23
    assert told[-1].outcome == "7 further causes"
    assert told[-1].points == 7


def test_the_slowest_and_the_worst_come_first():
    found = findings(300)
    seconds = found.frame["wall_time"]
    assert [*slowest(found, 5)] == [*seconds.sort_values(ascending=False).index[:5]]
    settling = found.frame["settling_time"]
    rows = worst(limits(found)[0], 4)
    assert [*settling[rows]] == [*settling.nlargest(4)]
    assert np.isfinite(settling[worst(found.columns["settling_time"], 400)]).all()
