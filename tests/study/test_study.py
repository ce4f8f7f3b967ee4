"""Studies as a whole: run, gone on with, refused, done again."""

import pickle
from concurrent.futures import ThreadPoolExecutor
from itertools import islice

import numpy as np
import pytest

import ann_dc
from ann_dc.errors import ArgumentError, StoreError, StudyError, UnknownNameError
from ann_dc.study.metrics import Metric
from ann_dc.study.records import CIRCUMSTANCES
from ann_dc.study.store import Store
from ann_dc.study.study import Study
from ann_dc.study.tasks import Task

METRICS = ["settling_time", "control_error"]
MISMATCH = "nonideal.mismatch"
CHIPS = {MISMATCH: [0.0, 0.02]}


def chips(**given) -> Study:
    given = {"subject": "double_integrator", "vary": CHIPS, "metrics": METRICS, **given}
    return Study(samples=6, fixed={"problem.N": 5}, **given)


def said(table) -> list[dict]:
    """Rows without what differs from run to run."""
    return [{n: v for n, v in row.items() if n not in CIRCUMSTANCES} for row in table.rows()]


@pytest.fixture(scope="module")
def table():
    return chips().run(workers=0)


def test_the_table(table):
    assert len(table) == 12
    assert table.outcomes == {"settled": 12}
    assert table.is_complete
    exact, off = table.by("nonideal.mismatch").values()
    assert exact["control_error"].max() < 1e-6
    assert off["control_error"].min() > 1e-4
    assert exact["seed"].tolist() == off["seed"].tolist()
    assert exact.yield_of({"control_error": 1e-6}).share == 1.0
    assert table.yield_of({"control_error": 1e-6}).passed == 6
    frame = table.to_frame()
    assert list(frame.columns) == list(chips().columns)
    with pytest.raises(UnknownNameError, match="column"):
        table["speed"]
    with pytest.raises(UnknownNameError, match="column"):
        table.yield_of({"power": 1.0})


@pytest.mark.slow
def test_rows_are_the_same_whoever_does_the_work(table, tmp_path):
    with ThreadPoolExecutor(2) as executor:
        threads = chips().run(tmp_path / "threads", executor=executor)
    assert said(threads) == said(table)
    assert said(chips().run(workers=1)) == said(table)


def test_a_study_goes_on_where_it_was(table, tmp_path):
    study = chips()
    with Store.begin(tmp_path, study.identity(), study.columns) as store:
        done = study.work(Task(tuple(islice(study.points(), 4))))
        signed = {"versions": table["versions"][0]}
        store.append([one._replace(row=one.row | signed) for one in done])
    again = study.run(tmp_path, workers=0)
    assert said(again) == said(table)
    assert said(study.run(tmp_path, workers=0)) == said(table)


def test_a_changed_study_refuses_to_mix(tmp_path):
    chips().run(tmp_path, workers=0)
    with pytest.raises(StoreError, match=r"vary\.nonideal\.mismatch"):
        chips(vary={"nonideal.mismatch": [0.0, 0.03]}).run(tmp_path, workers=0)
    with pytest.raises(StoreError, match="seed"):
        chips(seed=1).run(tmp_path, workers=0)
    with pytest.raises(StoreError, match="metrics"):
        chips(metrics=["settling_time"]).run(tmp_path, workers=0)


def test_words_may_change(tmp_path):
    chips(title="first").run(tmp_path, workers=0)
    again = chips(title="second", spec={"control_error": 1e-6}).run(tmp_path, workers=0)
    assert again.yield_of().passed == 6
    with Store.open(tmp_path) as store:
        assert store.identity["title"] == "second"


def test_what_failed_is_done_again_when_asked(tmp_path):
    study = Study(
        subject=ann_dc.plants.double_integrator(N=3),
        vary={"design.preconditioner": ["multilevel", "diagonal"]},
        fixed={"gains.coarse": 2.0},  # time constants have no coordinators
        metrics=["neurons"],
    )
    first = study.run(tmp_path, workers=0)
    assert first.outcomes == {"settled": 1, "failed": 1}
    assert not first.is_complete
    kept, again = (study.run(tmp_path, workers=0, retry=retry) for retry in (False, True))
    assert kept["wall_time"].tolist() == first["wall_time"].tolist()
    assert again["wall_time"][0] == first["wall_time"][0]
    assert again["wall_time"][1] != first["wall_time"][1]


def test_curves_are_kept_beside_the_rows(tmp_path):
    study = chips(curves=30)
    study.run(tmp_path, workers=0)
    with Store.open(tmp_path) as store:
        curves = store.curves(3)
    assert 10 < len(curves["time"]) <= 30
    assert curves["residuals"].shape[1] == 2
    assert curves["u.a"].shape == (len(curves["time"]), 5)
    assert curves["residuals"][-1].max() < 1e-6


def test_a_metric_that_is_nan_everywhere_is_a_column_of_nan():
    table = chips(metrics=["settling_time", "power"]).run(workers=0)
    assert np.isnan(table["power"]).all()
    assert all("no circuit is built" in row["message"] for row in table.rows())


def test_a_metric_of_ones_own():
    own = Metric(name="twice", unit="", definition="", value=lambda s: 2 * s.settling_time)
    table = chips(metrics=["settling_time", own]).run(workers=0)
    np.testing.assert_allclose(table["twice"], 2 * table["settling_time"])


@pytest.mark.parametrize(
    "given", [{"samples": 0}, {"seed": -1}, {"curves": 1.5}, {"time_limit": 0.0}]
)
def test_numbers_that_are_none(given):
    with pytest.raises(ArgumentError):
        Study(subject="car", **given)


def test_points_that_are_not_there():
    with pytest.raises(StudyError, match="there are 12 cases"):
        chips().row(12)


def test_what_travels_is_the_study(table):
    again = pickle.loads(pickle.dumps(chips()))
    assert again.identity() == chips().identity()
    assert said(again.run(workers=0)) == said(table)
    declared = chips(subject=ann_dc.plants.double_integrator(N=5))
    assert pickle.loads(pickle.dumps(declared)).identity() == declared.identity()


KINDS = {"design.preconditioner": ["multilevel", "diagonal"]}


@pytest.mark.parametrize(
    "given",
    [
        {"vary": KINDS},
        {"vary": {"gains.rho": [0.3, 1]}},
        {"vary": {MISMATCH: [0.0]}},
        {"vary": KINDS, "fixed": {"initial_guess.kind": "line"}},
        {"vary": {"seed": [1, 2], MISMATCH: [0.1]}},
    ],
)
def test_samples_that_would_all_be_the_same_are_refused(given):
    with pytest.raises(StudyError, match=r"samples: .* 5 equal records; omit samples, or .*tol"):
        Study(subject="double_integrator", samples=5, **given)


@pytest.mark.parametrize(
    "given",
    [
        {"vary": {MISMATCH: [0.0, 0.1]}},
        {"vary": KINDS, "fixed": {"initial_guess.spread": 0.1}},
        {"vary": {"initial_guess.kind": ["line", "random"]}},
        {"vary": {"tolerance.resistor": [0.01]}},
        {"vary": {"gains.rho": (0.3, 3.0)}},
        {"vary": KINDS, "metrics": [Metric(name="drawn", value=lambda sample: sample.point.seed)]},
    ],
)
def test_samples_of_something_that_is_drawn_are_taken(given):
    assert len(Study(subject="double_integrator", samples=5, **given)) >= 5
