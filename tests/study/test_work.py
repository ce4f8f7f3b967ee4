"""What is done at the points of a study, against the same done by hand."""

import re

import numpy as np
import pytest

import ann_dc
from ann_dc.decomposition.form import switch
from ann_dc.fidelity.circuit_study import predicted_errors
from ann_dc.network.cell import Cell, Connection, Neuron
from ann_dc.network.network import Network
from ann_dc.study.metrics import Metric
from ann_dc.study.study import Study
from ann_dc.study.tasks import Task


def rows(study: Study) -> list[dict]:
    """All rows, in one task."""
    return [finished.row for finished in study.work(Task(tuple(study.points())))]


def column(found, name) -> np.ndarray:
    return np.array([row[name] for row in found], float)


def test_targets_settle_where_runs_alone_settle():
    study = Study(
        subject="double_integrator", vary={"input.q_d.x": [0.5, 1.0, 2.0]},
        metrics=["settling_time", "objective", "certified"],
    )  # fmt: skip
    found = rows(study)
    network = ann_dc.design(ann_dc.plants.double_integrator()).network
    batch = ann_dc.OdeBackend().run_batch(network, {"q_d.x": [0.5, 1.0, 2.0]})
    np.testing.assert_allclose(column(found, "settling_time"), batch.settling_times, rtol=1e-7)
    objectives = column(found, "objective")  # quadratic: four times as much for twice the way
    np.testing.assert_allclose(objectives / objectives[1], [0.25, 1.0, 4.0], rtol=1e-6)
    assert all(row["certified"] is True for row in found)


def test_a_sample_is_the_same_alone_and_in_a_batch():
    study = Study(
        subject="double_integrator", vary={"nonideal.mismatch": [0.01]},
        fixed={"nonideal.time_constants": 0.02, "problem.N": 5}, samples=9,
        metrics=["settling_time", "control_error"],
    )  # fmt: skip
    together = rows(study)
    for row in together[::4]:
        alone = study.row(row["point"])
        for name in ("seed", "settling_time", "control_error", "outcome"):
            assert alone[name] == row[name], name
    errors = column(together, "control_error")
    assert len(set(errors)) == 9
    assert errors.max() < 0.5


@pytest.mark.slow
def test_a_draw_that_is_no_network_costs_its_own_point():
    study = Study(
        subject="double_integrator", vary={"nonideal.time_constants": [0.4]}, samples=12, seed=1,
        fixed={"problem.N": 20}, metrics=["settling_time"],
    )  # fmt: skip
    together = rows(study)
    outcomes = [row["outcome"] for row in together]
    assert "failed" in outcomes
    for row in together:
        alone = study.row(row["point"])
        assert alone["outcome"] == row["outcome"]
        if row["outcome"] == "settled":
            assert alone["settling_time"] == row["settling_time"]


def test_a_wiring_without_code_runs_alone_too():
    wires = (
        Connection(source="x", target="x", weight=-1.0),
        Connection(source="x", target="x", template=-2, weight=0.5),
        Connection(source="drive", target="x"),
    )
    cell = Cell(neurons=(Neuron(name="x"),), inputs=("drive",), connections=wires)
    row = Network(cell=cell, stages=4, inputs={"drive": 1.0})
    study = Study(subject=row, vary={"input.drive": [1.0, 2.0]}, metrics=["settling_time"])
    together, alone = rows(study), [study.row(point) for point in range(2)]
    assert [r["outcome"] for r in together] == [r["outcome"] for r in alone] == 2 * ["settled"]
    assert [r["settling_time"] for r in together] == [r["settling_time"] for r in alone]


def test_twice_the_time_constants_settle_in_twice_the_time():
    study = Study(
        subject="double_integrator", vary={"gains.tau": [1.0, 2.0, 4.0]},
        fixed={"design.preconditioner": "diagonal"},
        metrics=["settling_time", "predicted_decay_rate", "spectral_ratio"],
    )  # fmt: skip
    found = rows(study)
    times, rates = column(found, "settling_time"), column(found, "predicted_decay_rate")
    np.testing.assert_allclose(times / times[0], [1, 2, 4], rtol=1e-3)
    np.testing.assert_allclose(rates * [1, 2, 4] / rates[0], 1, rtol=1e-6)
    np.testing.assert_allclose(
        column(found, "spectral_ratio"), found[0]["spectral_ratio"], rtol=1e-6
    )


def test_defects_that_add_neurons_run_one_by_one():
    study = Study(
        subject="double_integrator", vary={"nonideal.offset": [0.0, 1e-3]}, samples=2,
        metrics=["control_error", "neurons", "resting_decay_rate"],
    )  # fmt: skip
    found = rows(study)
    exact, off = found[:2], found[2:]
    assert all(row["control_error"] < 1e-6 for row in exact)
    assert all(row["control_error"] > 1e-5 for row in off)
    assert all(row["resting_decay_rate"] > 0 for row in found)
    poles = Study(
        subject="double_integrator",
        fixed={"nonideal.extra_pole": 1e2, "design.preconditioner": "diagonal", "problem.N": 3},
        metrics=["neurons", "resting_decay_rate"],
    )  # fmt: skip
    (row,) = rows(poles)
    assert row["neurons"] > ann_dc.synthesize(ann_dc.plants.double_integrator(N=3)).size
    assert np.isnan(row["resting_decay_rate"])
    assert "add neurons" in row["message"]


@pytest.mark.sampled(1)
@pytest.mark.parametrize("form", ["S7", "S16"])
def test_printed_forms_run_as_solve_runs_them(form):
    study = Study(
        subject="car", fixed={"design.form": form},
        metrics=["settling_time", "objective", "certified"],
    )  # fmt: skip
    (row,) = rows(study)
    solution = ann_dc.solve(ann_dc.plants.car(), form=switch(form))
    assert row["outcome"] == "settled"
    assert row["objective"] == pytest.approx(solution.objective, rel=1e-6)
    assert row["certified"] == solution.certified


def test_drawn_circuits_are_those_of_the_fidelity_room():
    study = Study(
        subject="double_integrator", vary={"tolerance.resistor": [0.01]}, samples=3,
        fixed={"circuit.level": "tl072_ad633", "problem.N": 5}, metrics=["control_error", "power"],
    )  # fmt: skip
    found = rows(study)
    problem = ann_dc.plants.double_integrator(N=5)
    network = ann_dc.design(problem, preconditioner=ann_dc.PreconditionerKind.DIAGONAL).network
    level = ann_dc.presets.get("tl072_ad633")
    circuit, probe = ann_dc.SpiceBackend(level=level).prepare(network)
    seeds = [row["seed"] for row in found]
    errors = predicted_errors(circuit, level, probe, seeds)
    np.testing.assert_allclose(column(found, "control_error"), errors, rtol=1e-6)
    assert all(row["power"] > 0 for row in found)


def test_a_point_that_fails_is_a_row_that_says_why():
    study = Study(subject="double_integrator", vary={"nonideal.time_constants": [0.01, 3.0]})
    good, bad = rows(study)
    assert good["outcome"] == "settled"
    assert bad["outcome"] == "failed"
    assert re.search(r"time constant .* must be positive", bad["message"])
    wrong = Study(
        subject=ann_dc.plants.double_integrator(N=3),
        vary={"design.preconditioner": ["multilevel", "diagonal"]},
        fixed={"gains.coarse": 1.0},  # time constants have no coordinators
        metrics=["neurons"],
    )
    assert [row["outcome"] for row in map(wrong.row, range(2))] == ["settled", "failed"]


def test_a_metric_without_meaning_is_nan_and_the_row_says_so():
    (row,) = rows(Study(subject="double_integrator", metrics=["settling_time", "power"]))
    assert row["settling_time"] > 0
    assert np.isnan(row["power"])
    assert row["message"] == "power: no circuit is built; set circuit.level"


def test_a_metric_that_raises_costs_its_own_cell():
    own = Metric(
        name="own", unit="", definition="", value=lambda s: 1 / (s.setting["gains.rho"] - 1)
    )
    found = rows(Study(subject="double_integrator", vary={"gains.rho": [1.0, 2.0]}, metrics=[own]))
    assert [row["outcome"] for row in found] == ["settled", "settled"]
    assert np.isnan(found[0]["own"])
    assert found[0]["message"] == "own: ZeroDivisionError: float division by zero"
    assert found[1]["own"] == 1.0


def test_a_network_of_ones_own():
    network = ann_dc.design(ann_dc.plants.double_integrator(N=3)).network
    study = Study(subject=network, vary={"input.q_d.x": [1.0, 2.0]}, metrics=["settling_time"])
    assert [row["outcome"] for row in rows(study)] == ["settled", "settled"]


def test_circuits_of_a_study_have_resistors_of_its_series():
    """Exact ones cost what finite gain does, those of E12 are up to 10 % off."""
    study = Study(
        subject=ann_dc.plants.double_integrator(N=3), vary={"circuit.series": ["exact", "E12"]},
        fixed={"circuit.level": "macro"}, metrics=["control_error"],
    )  # fmt: skip
    exact, coarse = column(rows(study), "control_error")
    assert coarse > 30 * exact


def test_tolerances_of_a_foundrys_level_are_drawn():
    """Where circuits are emulated there is no model that would draw them."""
    study = Study(
        subject=ann_dc.plants.double_integrator(N=3), vary={"tolerance.offset": [0.0, 2e-2]},
        fixed={"circuit.level": "sky130", "tolerance.resistor": 0.0}, metrics=["control_error"],
    )  # fmt: skip
    none, some = column(rows(study), "control_error")
    assert some > 10 * none
