"""Metrics against closed forms, against each other, and under other tolerances of the run."""

import numpy as np
import pytest

import ann_dc
from ann_dc.study.metrics import METRICS
from ann_dc.study.study import Study
from ann_dc.study.tasks import Task

TIMES = ["settling_time", "verified_settling_time", "predicted_settling_time"]


def rows(**given) -> list[dict]:
    study = Study(subject="double_integrator", **given)
    return [finished.row for finished in study.work(Task(tuple(study.points())))]


def test_every_metric_is_defined():
    for name, metric in METRICS.items():
        assert metric.name == name
        assert metric.definition.endswith(".")


@pytest.mark.parametrize("tolerance", [1e-3, 1e-6])
def test_settling_is_verified_and_predicted_at_the_tolerance_of_the_run(tolerance):
    (row,) = rows(metrics=TIMES, fixed={"run.tolerance": tolerance, "problem.N": 5})
    measured, *others = (row[name] for name in TIMES)
    assert others == pytest.approx(2 * [measured], rel=0.05)


def test_the_tail_falls_as_the_slowest_mode():
    metrics = ["measured_decay_rate", "predicted_decay_rate", "resting_decay_rate"]
    (row,) = rows(
        metrics=metrics, fixed={"run.tolerance": 1e-8, "design.preconditioner": "diagonal"}
    )
    measured, predicted, saturated = (row[name] for name in metrics)
    assert measured == pytest.approx(predicted, rel=0.25)
    assert saturated == pytest.approx(predicted, rel=1e-6)


def test_theta_of_a_path_that_only_falls():
    (row,) = rows(metrics=["theta_growth", "theta_rising"], fixed={"problem.N": 5})
    assert row["theta_growth"] >= 1
    assert 0 <= row["theta_rising"] < 1


def test_what_a_certificate_says():
    metrics = ["objective", "kkt_residual", "accuracy_floor", "certified"]
    (row,) = rows(metrics=metrics, fixed={"problem.N": 5})
    solution = ann_dc.solve(ann_dc.plants.double_integrator(N=5))
    assert row["objective"] == pytest.approx(solution.objective, rel=1e-7)
    assert row["certified"] is True
    assert row["kkt_residual"] < 1e-6
    assert row["accuracy_floor"] < 1e-5


def test_the_oracle_of_s16_is_that_of_the_inputs_and_no_metric_looks_past_it():
    given = {"fixed": {"design.form": "S16", "problem.N": 3}, "metrics": [*TIMES, "objective"]}
    by_input, by_problem = (
        rows(vary={n: [2.0]}, **given)[0] for n in ("input.q_d.x", "problem.q_d.x")
    )
    assert by_input["outcome"] == by_problem["outcome"] == "settled"
    assert by_input["objective"] == pytest.approx(by_problem["objective"], rel=1e-6)
    assert np.isnan(by_input["verified_settling_time"])
    assert np.isnan(by_input["predicted_settling_time"])


def test_seconds_of_a_network_and_of_its_circuit_tell_the_same_event():
    """At 10 MHz op amps settle later than ideal integrators, by less than a half."""
    backends = ["ode", "emulation"]
    ode, board = rows(
        vary={"run.backend": backends}, metrics=["seconds", "power", "energy"],
        fixed={"circuit.level": "tl072_ad633", "problem.N": 5, "design.penalty": 0.4},
    )  # fmt: skip
    assert 0.5 < ode["seconds"] / board["seconds"] < 1.05
    assert board["energy"] == pytest.approx(board["power"] * board["seconds"])


def test_control_errors_where_a_factor_of_the_recipe_is_set_beside_a_circuit():
    given = {"circuit.level": "macro", "problem.N": 5, "design.preconditioner": "diagonal"}
    (row,) = rows(metrics=["control_error"], fixed=given | {"design.penalty": 0.5})
    assert 0 < row["control_error"] < 1e-3


def test_no_tolerance_is_no_error():
    given = {"circuit.level": "macro", "problem.N": 5}
    exact, off = rows(
        metrics=["control_error"], vary={"tolerance.resistor": [0, 1e-3]}, fixed=given
    )
    assert exact["control_error"] < 1e-4 < off["control_error"]
