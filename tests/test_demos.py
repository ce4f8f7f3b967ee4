"""Every demo runs, says what it claims, and leaves its figures behind."""

import importlib.util
import re
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from reference import best_of
from simulator import needs_ngspice

import ann_dc
from ann_dc.decomposition.form import SWITCHES
from ann_dc.export.catalogue import FORMATS
from ann_dc.study import Table

DEMOS = Path(__file__).parents[1] / "demos"


def demo(name: str):
    spec = importlib.util.spec_from_file_location(f"demo_{name}", DEMOS / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    # dataclasses look their module up
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


def assert_drawn(result: dict, count: int):
    assert len(result["figures"]) == count
    assert all(path.stat().st_size > 10_000 for path in result["figures"])


def test_every_demo_opens_with_question_answer_figure():
    for path in sorted(DEMOS.glob("[0-9]*.py")):
        text = path.read_text(encoding="utf-8")
        assert all(word in text for word in ("Question:", "Answer:", "Figure:")), path.name


@pytest.mark.slow
def test_the_papers_example(tmp_path, capsys):
    result = demo("01_paper_example").main(tmp_path)
    assert_drawn(result, 11)
    for D, optimum in ((1.0, 398.6315284), (0.5, 368.1892543)):
        row = result["table"][D]
        assert row["settled"]
        assert row["second_order"]
        assert row["objective"] == pytest.approx(optimum, rel=1e-6)
        assert row["kkt_residual"] < 1e-6
        assert row["rollout_error"] < 1e-5
    meaning = capsys.readouterr().out
    assert "form: corrected" in meaning
    assert re.search(r"^  neurons +18  150 live$", meaning, re.MULTILINE)


@pytest.mark.slow
def test_what_each_slip_does(tmp_path):
    names = ("corrected", "S1", "S3", "S7", "S12", "S16", "printed")
    result = demo("02_misprints").main(tmp_path, names)
    assert_drawn(result, 1)
    table = result["table"]
    optimum = pytest.approx(398.6315284, rel=1e-6)
    for name in ("corrected", "S12", "S16"):
        assert table[name]["outcome"] == "settled", name
        assert table[name]["objective"] == optimum, name
    assert table["corrected"]["kkt_residual"] < 1e-6
    for name in ("S1", "S3", "printed"):
        assert table[name]["outcome"] != "settled", name
    assert table["S7"]["outcome"] == "settled"  # on another problem's optimum
    assert table["S7"]["rollout_error"] > 0.02  # of a scale: 0.1 m and more
    assert table["S3"]["neuron"].startswith("mu[")


def test_without_control_jacobian_q_rests_on_a_straight_line():
    result = demo("02_misprints").main(names=("S3",))
    line = result["straight_line"]
    assert line["unevenness"] < 0.01
    assert line["bend"] < 0.01
    assert abs(line["growth_of_mu_y"]) > 1
    assert line["constraint_residual"] > 0.01
    assert result["table"]["S3"]["rollout_error"] > 0.8  # of the scale of y, 5 m


def test_your_own_problem(tmp_path):
    result = demo("03_own_problem").main(tmp_path)
    assert_drawn(result, 5)
    assert result["solution"]["settled"]
    assert result["solution"]["second_order"]
    assert result["solution"]["rollout_error"] < 1e-5


@pytest.mark.slow
def test_settling_and_stability(tmp_path):
    result = demo("04_settling_and_stability").main(tmp_path, fast=True)
    assert_drawn(result, 1)
    for sweep in result["sweeps"].values():
        for one in sweep.values():
            for point in one["dots"]:
                if np.isfinite(point["measured"]):
                    assert point["abscissa"] < 0
                    assert 0.4 < point["measured"] / point["predicted"] < 1.3
                if point["abscissa"] > 0:
                    assert np.isnan(point["measured"])
    assert 0.2 < result["sweeps"]["rho"]["multilevel"]["boundary"] < 0.6


@pytest.mark.slow
def test_recurrent_layers(tmp_path):
    result = demo("05_recurrent_layers").main(tmp_path)
    assert_drawn(result, 1)
    steps = result["steps"]
    assert result["best_fixed"] <= 240
    assert steps["two-phase"] <= 280
    assert max(steps["simultaneous, Anderson"], steps["two-phase, Anderson"]) <= 160
    assert steps["simultaneous"] <= 1.3 * result["best_fixed"]  # a rule that knows no solution
    assert all((count is None) == (share > 1) for share, count in result["scan"].items())


@pytest.mark.slow
def test_two_levels(tmp_path):
    result = demo("06_two_levels").main(tmp_path)
    assert_drawn(result, 4)
    iterations = result["iterations"]
    assert iterations["plain, oracle |B/A|/2"] == -1
    assert 3 < iterations["augmented, two gains"] <= 330
    assert iterations["augmented, two gains"] == pytest.approx(result["predicted"], rel=0.1)
    assert iterations["Newton coordinator"] <= 10
    assert result["warm"][0.2] <= 4
    assert not result["hypothesis"].holds


def test_many_at_once(tmp_path):
    result = demo("07_batch").main(tmp_path, side=5)
    assert_drawn(result, 1)
    assert result["run"].settled.all()
    assert result["feedback"].shape == (2, 4)


@pytest.mark.slow
def test_ten_thousand_settling_times(tmp_path):
    result = demo("14_settling_times").main(tmp_path, cars=200)
    assert_drawn(result, 1)
    pyramid, grid = result["times"].values()
    assert all(batch.settled.all() for batch in result["batches"].values())
    assert np.median(grid) < 0.5 * np.median(pyramid)


@pytest.mark.slow
def test_inequalities(tmp_path):
    result = demo("15_inequalities").main(tmp_path)
    assert_drawn(result, 1)
    free, held = result["free"], result["held"]
    assert free.certified
    assert held.certified
    assert held.objective > free.objective
    rows, kept = held.problem.inequalities, held.certificate.complementarity
    last = result["conducting"][-1]
    assert {rows[row].name for row in np.flatnonzero(last.any(axis=1))} == {"disc2", "varphi_low"}
    at_limit = np.isclose(np.stack([held["nu"], held["eta"]]), [[4], [2.5]], atol=1e-9)
    assert (last.sum(), at_limit.sum()) == (6, 9)
    assert kept.strong == 15
    assert (result["conducting"].any(axis=0) & ~last).sum() > 6  # others, on the way


@pytest.mark.slow
def test_navigation(tmp_path):
    result = demo("17_navigation").main(tmp_path)
    assert_drawn(result, 1)
    network, waypoint, printed = result["journeys"].values()
    assert not any(journey.collided for journey in network)
    assert sum(journey.arrived for journey in network) >= 8  # of 12: 90 to 95 % of 200 in the bench
    hurt = [sum(j.collided for j in journeys) for journeys in (network, waypoint, printed)]
    assert hurt == sorted(hurt)  # every leg that is left out is one that nobody planned


@pytest.mark.slow
def test_the_feedback_gain_predicts_the_next_optimum():
    """A start moved by a centimetre: u_0 of the re-solved problem, and u_0 + K dq_0."""
    problem = ann_dc.plants.car()
    gain = demo("07_batch").feedback(ann_dc.design(problem).network)
    before, moved = np.zeros(4), np.array([0.01, -0.005, 0.01, 0.005])
    first = [ann_dc.solve(problem.with_inputs(q_0=tuple(q_0)))["u"][0] for q_0 in (before, moved)]
    np.testing.assert_allclose(first[1] - first[0], gain @ moved, rtol=0.1, atol=2e-3)


@pytest.mark.slow
def test_how_far_from_the_limit(tmp_path):
    result = demo("11_preconditioner_limit").main(tmp_path, names=("car", "unicycle"))
    assert_drawn(result, 2)
    for rows in result["table"].values():
        found = {row.kind: row for row in rows}
        assert set(found) == set(ann_dc.PreconditionerKind)
        assert all(row.solution.certified for row in rows)
        alone, grid = (
            found[ann_dc.PreconditionerKind.DIAGONAL],
            found[ann_dc.PreconditionerKind.RESISTIVE_GRID],
        )
        pyramid, tree = (
            found[ann_dc.PreconditionerKind.MULTILEVEL],
            found[ann_dc.PreconditionerKind.CYCLIC_REDUCTION],
        )
        assert 2 < grid.ratio < pyramid.ratio < alone.ratio
        assert grid.settling < min(60, pyramid.settling) < alone.settling
        assert 0 == alone.per_cell < grid.per_cell < pyramid.per_cell < tree.per_cell


@pytest.mark.slow
def test_one_network_for_many_inputs(tmp_path):
    result = demo("12_operating_range").main(tmp_path, held_out=40, starts=6)
    assert_drawn(result, 2)
    ours, theirs = result["units"]
    assert ours.solution.certified
    assert theirs.solution.certified
    assert ours.steps == theirs.steps
    assert ours.ratio == pytest.approx(theirs.ratio, rel=1e-6)
    assert ours.settling == pytest.approx(theirs.settling, rel=1e-3)
    np.testing.assert_allclose(ours.solution["T_c"], theirs.solution["T_c"] + 273.15, rtol=1e-5)
    np.testing.assert_allclose(ours.solution["c"], theirs.solution["c"] / 1000, rtol=1e-5)
    assert result["family"].validation.share == 1.0
    assert result["family"].validation.settling_quantile(0.99) < 150
    found = result["starts"]
    assert [o.objective for o in found.optima] == pytest.approx([4.92993, 6.00941], rel=1e-4)
    assert sum(o.count for o in found.optima) + found.unsettled == 6


@pytest.mark.slow
def test_how_long_and_whether_at_all(tmp_path):
    result = demo("13_free_final_time").main(tmp_path, prices=(0.3, 3.0))
    assert_drawn(result, 1)
    assert result["certified"]
    assert result["times"][3.0] < result["times"][0.3]
    assert result["refused"]["status"] == "infeasible"
    assert "q_d.x = -3 m" in result["refused"]["message"]


@needs_ngspice
@pytest.mark.slow
def test_a_circuit(tmp_path):
    result = demo("08_circuit").main(tmp_path, gains=(1e4, 1e6), margins=(10.0,))
    assert_drawn(result, 1)
    assert result["ideal"].control_error < 1e-5
    assert result["ideal"].mean_square_error < 1e-5
    assert result["gain"][1e6] < 1e-4
    assert result["gain"][1e4] / result["gain"][1e6] == pytest.approx(100, rel=0.1)
    assert 6 < result["threshold"] < 8
    found = result["margin"][10.0]
    assert found.settling == pytest.approx(found.predicted, rel=0.02)
    assert found.settling < 40e-6


@needs_ngspice
@pytest.mark.slow
def test_the_ladder(tmp_path):
    wanted = ("behavioural", "E96 resistors only", "opa192_ad734", "transistor")
    result = demo("09_level_comparison").main(tmp_path, wanted=lambda rung: rung.name in wanted)
    assert_drawn(result, 1)
    rungs = result["rungs"]
    assert set(wanted) < set(rungs)
    assert rungs["behavioural"].error < 1e-5
    assert rungs["transistor"].error < 5e-3
    assert rungs["transistor"].settling < 15e-6
    for name in ("E96 resistors only", "opa192_ad734"):
        assert rungs[name].error == pytest.approx(rungs[name].predicted_error, rel=1e-2)
        assert rungs[name].settling == pytest.approx(rungs[name].predicted_settling, rel=2e-2)
    assert rungs["fatrop on this CPU"].settling > rungs["transistor"].settling


@pytest.mark.slow
@needs_ngspice
def test_what_to_pay_for(tmp_path):
    result = demo("10_error_budget").main(tmp_path, samples=3)
    assert_drawn(result, 1)
    assert sum(result["shares"].values()) == pytest.approx(1.0)
    drawn = result["samples"]
    np.testing.assert_allclose(drawn.predicted, drawn.measured, rtol=1e-2)


@pytest.mark.slow
def test_minimax(tmp_path):
    result = demo("16_minimax").main(tmp_path, points=5)
    assert_drawn(result, 1)
    front, run = result["front"], result["run"]
    assert front.certified.all()
    effort, length = front.values[np.argsort(front.weights[:, 0])].T
    assert (np.diff(effort) < 0).all()
    assert (np.diff(length) > 0).all()
    assert run.status.settled
    path = run.trajectory
    assert path["J.effort"][-1, -1] == pytest.approx(path["J.length"][-1, -1], abs=1e-6)
    assert path["z_J.effort"][-1, -1] + path["z_J.length"][-1, -1] == pytest.approx(1.0, abs=1e-7)


@pytest.mark.slow
def test_settling_against_gains(tmp_path):
    result = demo("18_settling_against_gains").main(
        tmp_path,
        kinds=("diagonal",),
        factors=(0.02, 0.1, 1.0, 2.15),
        gains=("rho",),
        workers=0,
    )
    assert_drawn(result, 1)
    table = result["tables"]["diagonal"]["rho"]
    (edge,) = result["boundaries"]["diagonal"]["rho"]
    assert edge == pytest.approx(0.03, rel=0.1)
    assert (table["outcome"] == "settled").tolist() == [False, True, True, True]
    assert (table["resting_decay_rate"] > 0).tolist() == [False, True, True, True]
    ratio = (table["normalised_settling_time"] / table["settling_by_spectrum"])[1:]
    assert (ratio > 0.55).all()
    assert (ratio < 1.15).all()
    assert np.nanargmin(table["normalised_settling_time"]) == 2  # as designed


@pytest.mark.slow
def test_settling_against_stages(tmp_path):
    kinds = ("cyclic-reduction", "diagonal", "kept")
    stages = {("double_integrator", kind): (9, 12, 18) for kind in kinds}
    result = demo("19_settling_against_stages").main(tmp_path, stages=stages)
    assert_drawn(result, 1)
    flat, grows, kept = result["series"].values()
    assert np.ptp(flat.settling) < 0.05 * flat.settling.min()
    assert abs(flat.grows.value) < 0.05
    assert 0.5 < grows.grows.value < 1.5
    assert kept.grows.value > 1.8
    assert kept.settling[0] == pytest.approx(grows.settling[0], rel=0.01)  # its own penalty
    assert (flat.computing > 0).all()


@pytest.mark.parametrize(
    ("outcome", "certified", "error", "end"),
    [
        ("settled", 1.0, 1e-9, "OPTIMUM"),
        ("settled", 0.0, 1e-9, "CONTROLS"),
        ("settled", 0.0, 0.3, "ELSEWHERE"),
        ("settled", np.nan, np.nan, "ELSEWHERE"),
        ("diverged", 0.0, 1e-9, "NEVER"),
        ("failed", np.nan, np.nan, "NEVER"),
    ],
)
def test_the_end_of_a_form(outcome, certified, error, end):
    row = {"outcome": outcome, "certified": certified, "control_error": error}
    assert demo("20_equilibria_of_misprints").end_of(row).name == end


def test_the_study_of_forms_has_every_form():
    study = ann_dc.load_study(DEMOS / "forms.toml")
    assert study.vary["design.form"] == ["corrected", "printed", *SWITCHES]


def test_controls_of_a_slip_are_compared_with_the_corrected_networks():
    study = replace(
        ann_dc.load_study(DEMOS / "forms.toml"),
        subject=ann_dc.plants.double_integrator(N=5),
        vary={"design.form": ["corrected", "S7"]},
        fixed={"design.preconditioner": "diagonal"},
    )
    corrected, slip = study.run(workers=0).rows()
    assert corrected["control_error"] < 1e-6
    assert slip["outcome"] == "settled"
    assert slip["control_error"] > 1e-3


@pytest.mark.slow
def test_where_slips_settle(tmp_path):
    module = demo("20_equilibria_of_misprints")
    result = module.main(tmp_path, forms=("corrected", "S7", "S12", "S17"), workers=0)
    assert_drawn(result, 1)
    assert [end.name for end in result["ends"].values()] == [
        "OPTIMUM", "ELSEWHERE", "CONTROLS", "NEVER",
    ]  # fmt: skip
    rows = result["rows"]
    for name in ("corrected", "S12"):
        assert rows[name]["objective"] == pytest.approx(398.6315284, rel=1e-6), name
    assert rows["S12"]["kkt_residual"] == pytest.approx(8 / 9, rel=1e-3)  # multipliers over N = 9
    assert rows["S7"]["control_error"] == pytest.approx(0.026, rel=0.05)


@pytest.mark.slow
def test_orders_and_steps(tmp_path):
    result = demo("21_orders_and_steps").main(
        tmp_path, samples=16, shares=(0.5, 0.7, 1.05), kinds=("multilevel", "resistive-grid")
    )
    assert_drawn(result, 1)
    pyramid, grid = (result["found"][kind] for kind in ("multilevel", "resistive-grid"))
    for order, one in pyramid.items():
        assert one.settled[0] == 1.0, order
        assert one.settled[2] == 0.0, order
        assert 150 < one.adaptive < 250, order
    assert pyramid["simultaneous"].settled[1] == 1.0
    assert pyramid["two-phase"].settled[1] < 0.2  # the limit is none of this order
    assert grid["two-phase"].settled[2] > 0.9
    assert grid["simultaneous"].adaptive > 4 * grid["two-phase"].adaptive
    stable = np.mean(result["limits"]["resistive-grid"] > 1.05)
    assert grid["simultaneous"].settled[2] == pytest.approx(stable, abs=0.15)


@needs_ngspice
@pytest.mark.slow
def test_from_a_question_to_a_yield_curve(tmp_path):
    figures = {"tolerance.resistor": (1e-3, 3e-2), "circuit.bandwidth_margin": (5.0, 10.0, 13.0)}
    result = demo("22_yield").main(tmp_path, boards=3, checked=1, figures=figures, workers=0)
    assert_drawn(result, 1)
    shares = {
        name: [found.share for found in curve.values()] for name, curve in result["curves"].items()
    }
    assert shares["circuit.bandwidth_margin"] == [0, 1, 0]
    assert shares["tolerance.resistor"][0] == 1 > shares["tolerance.resistor"][1]
    margins = result["tables"]["circuit.bandwidth_margin"].by("circuit.bandwidth_margin")
    assert margins[5.0].outcomes == {"unstable equilibrium": 3}
    assert margins[13.0].outcomes == {"settled": 3}  # too slow
    spot = result["spot"]
    assert spot.off("control_error").max() < 1e-3
    assert spot.off("seconds").max() < 0.01
    slowest = margins[10.0]["slowest_mode_seconds"][0] / spot.simulated["seconds"][0]
    assert 1.2 < slowest < 1.3


def ends_of(**columns) -> list[str]:
    table = Table(columns={name: np.array(of) for name, of in columns.items()}, spec={})
    return [end.name for end in demo("23_basins_of_attraction").ends_of(table)]


def test_the_best_optimum_is_that_of_the_same_inputs():
    found = ends_of(
        **{"input.q_d.x": [1.0, 1.0, 2.0, 2.0]},
        objective=[5.0, 9.0, 9.0, 9.0 + 1e-6],
        certified=[1, 1, 1, 1],
        outcome=["settled"] * 4,
    )
    assert found == ["BEST", "OTHER", "BEST", "BEST"]


def test_a_lower_cost_that_is_no_optimum_is_not_the_best():
    found = ends_of(
        objective=[1.0, 2.0, np.nan, 0.5],
        certified=[0, 1, 0, 0],
        outcome=["settled", "settled", "diverged", "stalled"],
    )
    assert found == ["NO_OPTIMUM", "BEST", "NOWHERE", "NOWHERE"]


def test_a_convex_problem_has_one_basin():
    study = replace(
        ann_dc.load_study(DEMOS / "basin.toml"),
        subject="double_integrator",
        vary={"input.q_d.x": [0.5, 1.0], "initial_guess.spread": [0.1, 10.0]},
        samples=3,
    )
    assert len(study) == 12
    ends = demo("23_basins_of_attraction").ends_of(study.run(workers=0))
    assert {end.name for end in ends} == {"BEST"}


@pytest.mark.slow
def test_basins_of_attraction(tmp_path):
    result = demo("23_basins_of_attraction").main(
        tmp_path, ("car", "pendulum"), starts=6, side=3, of_a_map=2, workers=0
    )
    assert_drawn(result, 1)
    bars = {name: demo("23_basins_of_attraction").shares(t) for name, t in result["bars"].items()}
    said = {name: {spread: [*each.values()] for spread, each in bar.items()}
            for name, bar in bars.items()}  # fmt: skip
    assert said["car"][0.01] == said["car"][0.03] == [1, 0, 0, 0]
    assert said["car"][0.3] == said["car"][3.0] == [0, 0, 0, 1]
    assert said["pendulum"][0.03] == [1, 0, 0, 0]
    for best, other, no_optimum, nowhere in said["pendulum"].values():
        assert best + other == 1
        assert no_optimum == nowhere == 0
    assert any(other for _, other, _, _ in said["pendulum"].values())
    far = result["maps"]["car"]["input.q_d.x"] >= 3
    assert set(result["maps"]["car"]["outcome"][far]) == {"settled"}


@needs_ngspice
@pytest.mark.slow
def test_one_network_in_every_realisation(tmp_path):
    result = demo("24_realisations").main(tmp_path, samples=2, workers=0)
    assert_drawn(result, 1)
    tables = result["tables"]
    most = {"ODE": 1e-7, "recurrent": 1e-7, "ideal parts, ngspice": 1e-6, "op amps, ngspice": 4e-5}
    for name, error in most.items():
        assert tables[name].outcomes == {"settled": 2}
        assert tables[name]["control_error"].max() < error
    time = {name: table["control_settling_time"] for name, table in tables.items()}
    np.testing.assert_allclose(time["ideal parts, ngspice"], time["ODE"], rtol=0.01)
    np.testing.assert_allclose(time["op amps, emulated"], time["op amps, ngspice"], rtol=0.01)
    assert (time["op amps, ngspice"] > 1.1 * time["ODE"]).all()


@pytest.mark.slow
def test_tighter_limits(tmp_path):
    result = demo("25_tighter_limits").main(tmp_path, cars=4, limits=(0.6, 0.4), workers=0)
    assert_drawn(result, 1)
    loose, tight = (table.by("input.psi") for table in result["tables"].values())
    assert (loose[0.6]["active_rows"] == 0).all()
    assert (loose[0.4]["active_rows"] > 0).all()
    assert (loose[0.4]["settling_time"] > 1.4 * loose[0.6]["settling_time"]).all()
    assert np.median(tight[0.6]["settling_time"]) > 1.2 * np.median(loose[0.6]["settling_time"])
    for part in loose.values():
        assert (part["certified"] == 1).all()
    point = {name: loose[0.4][f"input.{name}"][0] for name in ("q_d.x", "q_d.y")}
    problem = demo("25_tighter_limits").car(0.4)
    moved = problem.with_inputs(q_d=(*point.values(), *problem.q_d[2:]))
    assert loose[0.4]["objective"][0] == pytest.approx(best_of(moved).objective, rel=1e-5)


@needs_ngspice
@pytest.mark.slow
def test_taking_the_network_away(tmp_path):
    module = demo("26_export")
    assert [name for _, names in module.KINDS.values() for name in names] == [*FORMATS]
    result = module.main(
        tmp_path,
        formats=("weights", "onnx", "nir", "pack", "conductances", "capacitors", "c99"),
        bits=(9, 12, 20),
        levels=(4, 64, 16384),
        units=(16, 128, 4096),
    )
    assert_drawn(result, 1)
    for found, octaves in zip(result["errors"].values(), (8, 8, 5)):
        none, coarse, fine = found.values()
        assert np.isnan(none)
        assert 2**octaves / 10 < coarse / fine < 2**octaves * 10
        assert 1e-3 < coarse < 0.1
    rows = {row.name: row for row in result["rows"]}
    assert "linear nodes only" in rows.pop("nir").why_not
    most = {"weights": 1e-12, "onnx": 1e-10, "conductances": 1e-12, "capacitors": 0.01, "c99": 1e-3}
    for name, error in most.items():
        assert rows[name].error < error, name
    assert rows["pack"].error == pytest.approx(27 / 1e6, rel=0.05)  # the law of A0
    assert all(row.bytes > 50_000 for row in rows.values())


@needs_ngspice
@pytest.mark.slow
def test_on_a_board(tmp_path):
    result = demo("27_parasitics").main(
        tmp_path,
        ann_dc.plants.double_integrator(N=3),
        simulated=("no effect", "bias current 1 uA", "feedthrough 0.3 %"),
        presets=("opa192_ad734", "tl072_ad633"),
        picofarads=(0, 4, 8),
    )
    assert_drawn(result, 1)
    rows = {row.effect.words: row for row in result["rows"]}
    seen = [row for row in rows.values() if row.measured_stable is not None]
    assert len(seen) == 3
    for row in seen:
        assert row.measured_error == pytest.approx(row.predicted_error, rel=0.01)
    assert rows["8 pF at every ground"].predicted_stable
    assert not rows["20 pF at every ground"].predicted_stable
    margins = [loop.phase_margin for loop in result["margins"].values()]
    assert margins == sorted(margins, reverse=True)
    for one in result["cured"] + result["shelf"]:
        assert np.isfinite(one.settling), one.name
    ohms = [one.ohms for one in result["cured"]]
    assert ohms == sorted(ohms, reverse=True)


@pytest.mark.slow
@needs_ngspice
def test_waveforms_and_convergence(tmp_path):
    result = demo("28_waveforms_and_convergence").main(
        tmp_path,
        ann_dc.plants.double_integrator(N=4),
        durations={"van der Pol": 20.0, "Chua": 8.7},
        margins=(1e3, 1e4),
    )
    assert_drawn(result, 7)
    assert result["errors"][1e3] > 5 * result["errors"][1e4]
    for _, circuit in result["runs"].values():
        assert circuit.mean_square_error < 1e-4
    times = [result["times"][name] for name in ("compiled", "RK45", "LSODA", "Radau", "BDF")]
    np.testing.assert_allclose(times, times[0], rtol=0.01)
    levels = result["counted"]["two levels"]
    assert levels.settled.all()
    assert levels.rounds < 10
