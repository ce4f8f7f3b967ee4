"""Studies as text, and back from the identity that a store keeps."""

import json
from dataclasses import replace

import pytest

import ann_dc
from ann_dc.errors import AnnDcError, FileFormatError, StudyError
from ann_dc.study.metrics import Metric
from ann_dc.study.study import Study
from ann_dc.study.study_file import load_study, study_from

WHOLE = """
title = "chips"
subject = "car"
metrics = ["settling_time", "control_error"]
samples = 8
sampling = "sobol"
seed = 5
curves = 10
time_limit = 30

[vary]
nonideal.mismatch = [0.003, 0.01]
input.q_d.x = {low = 3, high = 7}
"gains.rho" = {low = 0.1, high = 10, log = true, count = 3}

[fixed]
design.preconditioner = "multilevel"

[spec]
control_error = 0.05
settling_time = [0, 60]
"""


def written(folder, text: str):
    file = folder / "study.toml"
    file.write_text(text, encoding="utf-8")
    return file


def test_every_field_of_a_file(tmp_path):
    study = load_study(written(tmp_path, WHOLE))
    same = Study(
        subject="car", title="chips", metrics=["settling_time", "control_error"], samples=8,
        sampling=study.sampling, seed=5, curves=10, time_limit=30,
        vary={
            "nonideal.mismatch": [0.003, 0.01],
            "input.q_d.x": (3, 7),
            "gains.rho": study.plan.listed["gains.rho"],
        },
        fixed={"design.preconditioner": "multilevel"},
        spec={"control_error": 0.05, "settling_time": (0, 60)},
    )  # fmt: skip
    assert study.identity() == same.identity()
    assert study.plan.listed["gains.rho"] == pytest.approx([0.1, 1.0, 10.0])
    assert list(study.points()) == list(same.points())
    assert len(study) == 48


def test_a_problem_file_beside_it(tmp_path):
    problem = tmp_path / "boat.toml"
    problem.write_text(
        'states = ["x"]\ncontrols = ["v"]\ndt = 0.1\nhorizon = 4\nq_0 = [0]\nq_d = [1]\n'
        'cost = "v**2"\n[dynamics]\nx = "v"\n',
        encoding="utf-8",
    )
    study = load_study(written(tmp_path, 'subject = "boat.toml"\nvary.problem.N = [4, 8]\n'))
    assert [study.row(point)["outcome"] for point in (0, 1)] == ["settled", "settled"]


@pytest.mark.parametrize("subject", ["car", "declared"])
def test_an_identity_makes_the_same_study(subject):
    declared = replace(ann_dc.plants.car(), name="declared")
    study = Study(
        subject=subject if subject == "car" else declared,
        vary={"input.q_d.x": (1, 2), "gains.rho": [1.0, 2.0]},
        samples=3,
        spec={"settling_time": (None, 5.0)},
    )
    identity = json.loads(json.dumps(study.identity()))
    again = study_from(identity)
    assert json.loads(json.dumps(again.identity())) == identity
    assert list(again.points()) == list(study.points())


def test_what_only_python_can_repeat():
    network = ann_dc.design(ann_dc.plants.double_integrator(N=3)).network
    with pytest.raises(StudyError, match="declared in Python"):
        study_from(Study(subject=network).identity())
    own = Metric(name="mine", unit="", definition="One.", value=lambda sample: 1.0)
    study = Study(subject="double_integrator", metrics=[own])
    assert study.row(0)["mine"] == 1.0
    with pytest.raises(StudyError, match="unknown metric 'mine'"):
        study_from(study.identity())
    with pytest.raises(StudyError, match="another version"):
        study_from({**study.identity(), "version": 99})


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("samples = 3", "subject: is missing"),
        ('subject = "kar"', "kar"),
        ('subject = "car"\nsampels = 3', "sampels: is not a field of a study"),
        ('subject = "car"\nsamples = "3"', "samples: expected a whole number"),
        ('subject = "car"\nsamples = 0', "samples"),
        ('subject = "car"\nseed = true', "seed: expected a whole number"),
        ('subject = "car"\ntime_limit = -1', "limit"),
        ('subject = "car"\nsampling = "dice"', "sampling: expected one of random"),
        ('subject = "car"\nvary.input.q_d.x = {low = 3}', "a range is"),
        ('subject = "car"\nvary.input.q_d.x = {low = 3, high = 4, step = 1}', "a range is"),
        ('subject = "car"\nvary.gains.rho = {low = 0, high = 1, log = true, count = 3}', "low > 0"),
        ('subject = "car"\nvary.input.q_d.x = {low = 3, high = 4, count = 0}', "1 or more"),
        ('subject = "car"\nvary = 3', "vary: expected a table"),
        ('subject = "car"\nmetrics = "power"', "metrics: expected a list"),
        ('subject = "car"\nvary.input.q_d.z = [1]', "did you mean"),
        ('subject = "car"\nvary.problem.N = []', "expected one value or more"),
        ('subject = "none.toml"', "none.toml"),
    ],
)
def test_what_is_wrong_is_told_with_the_file_and_the_field(tmp_path, text, said):
    file = written(tmp_path, text)
    with pytest.raises(AnnDcError, match=said) as reported:
        load_study(file)
    assert str(file) in str(reported.value) or isinstance(reported.value, FileFormatError)


def test_nothing_in_a_file_is_executed(tmp_path):
    text = "subject = \"__import__('os').system('touch hacked')\"\n"
    with pytest.raises(AnnDcError):
        load_study(written(tmp_path, text))
    with pytest.raises(FileFormatError):
        load_study(tmp_path / "missing.toml")
