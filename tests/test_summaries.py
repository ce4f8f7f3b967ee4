"""Short representations of the records that a session shows."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import ann_dc
from ann_dc.backends.spice.circuit_run import CircuitRun
from ann_dc.families.front import Front
from ann_dc.study.table import Table
from ann_dc.summaries import LONGEST, summarised
from ann_dc.two_level.coordination import Coordination
from ann_dc.two_level.run import TwoLevelRun

PROBLEM = ann_dc.plants.double_integrator(N=3)

COLUMNS = {"neurons": np.ones(4), "outcome": np.full(4, "settled")}


@cache
def solution():
    return ann_dc.solve(PROBLEM)


RECORDS = {
    "problem": (lambda: PROBLEM, ("states: x, v", "controls: a", "stages: 3")),
    "solution": (solution, ("status: settled", "cost: ", "KKT residual: ", "certified: yes")),
    "design": (lambda: solution().design, ("settled: yes", "preconditioner: ")),
    "network": (
        lambda: solution().network,
        ("title: double_integrator", "preconditioner: ", "stages: 3"),
    ),
    "run": (lambda: solution().run, ("status: settled", "settling time: ", "steps: ")),
    "table": (
        lambda: Table(columns={"neurons": np.ones(4), "outcome": np.full(4, "settled")}, spec={}),
        ("rows: 4", "neurons"),
    ),
    "level": (ann_dc.levels.macro, ("name: macro", "models: macro")),
    "equations": (
        lambda: ann_dc.decompose(PROBLEM),
        ("problem: double_integrator", "form: corrected", "states: x, v"),
    ),
    "misprinted equations": (lambda: ann_dc.decompose(PROBLEM, "S8"), ("form: with S8",)),
    "cell": (lambda: solution().network.cell, ("neurons: q.x, q.v", "inputs: ")),
    "gains": (lambda: solution().design.gains, ("preconditioner: ", "rho: ", "rate: ")),
    "spectrum": (lambda: solution().design.spectrum, ("eigenvalues: ", "stiffness ratio: ")),
    "certificate": (lambda: solution().certificate, ("KKT residual: ", "certified: yes")),
    "trajectory": (lambda: solution().trajectory, ("network: double_integrator", "times: ")),
    "diagnosis": (lambda: ann_dc.diagnose(solution().design), ("reason: ", "advice: ")),
    "batch": (
        lambda: ann_dc.RecurrentBackend().run_batch(solution().network, {"q_d.x": [0.5, 1.0]}),
        ("samples: 2", "settled: 2 of 2", "steps: "),
    ),
    "study": (
        lambda: ann_dc.Study(subject=PROBLEM, vary={"input.q_d.x": [0.5, 1.0]}, samples=1),
        ("title: ", "cases: 2", "varied: input.q_d.x", "metrics: settling_time"),
    ),
    "multistart": (lambda: ann_dc.multistart(PROBLEM, 2), ("initial guesses: 2", "optima: 1")),
    "waveform": (
        lambda: ann_dc.Waveform(times=np.arange(500.0), values=np.zeros(500)),
        ("values: 500", "from: 0", "to: 499"),
    ),
    "circuit": (
        lambda: ann_dc.SpiceBackend(level="macro").prepare(
            ann_dc.design(PROBLEM, preconditioner="diagonal").network
        )[0],
        ("network: double_integrator", "parameters: "),
    ),
    "circuits": (lambda: ann_dc.SpiceBackend(level="macro"), ("level: macro", "series: exact")),
}


@pytest.mark.parametrize("name", RECORDS)
def test_representation_is_one_short_line_with_the_result(name):
    make, expected = RECORDS[name]
    text = repr(make())
    assert "\n" not in text
    assert len(text) < 500
    assert [part for part in expected if part not in text] == []


@pytest.mark.parametrize("name", RECORDS)
def test_notebook_table_has_a_row_for_every_value(name):
    make, expected = RECORDS[name]
    text = make()._repr_html_()
    assert text.startswith("<table>")
    assert [part for part in expected if part.partition(":")[0] not in text] == []


def test_notebook_table_escapes_text():
    problem = replace(PROBLEM, name="<b>&")
    assert "&lt;b&gt;&amp;" in problem._repr_html_()
    assert "<b>" not in problem._repr_html_()


def test_long_values_are_cut():
    @summarised(lambda self: {"value": "x" * 1000})
    class Long: ...

    assert len(repr(Long())) < LONGEST + 20


@pytest.mark.parametrize(
    "kind", [CircuitRun, Front, Coordination, TwoLevelRun, ann_dc.FamilyDesign]
)
def test_results_of_long_runs_have_a_short_representation(kind):
    assert kind.__repr__.__module__ == "ann_dc.summaries"
    assert kind._repr_html_.__module__ == "ann_dc.summaries"
