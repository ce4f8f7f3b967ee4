"""Solving from the command line: reports, files, exit codes, recurrent layers."""

import json
import sys

import numpy as np
import pytest
from command_line import PENDULUM, RECURRENT, SMALL, refused, run, strict, terminal
from torch_free import forget_torch

import ann_dc
from ann_dc.backends.ode import LIMIT, OdeBackend
from ann_dc.backends.recurrent import backend as recurrent_backend
from ann_dc.backends.recurrent.backend import RecurrentBackend
from ann_dc.optimality.certificate import LARGEST_RESIDUAL


def test_help_tells_the_defaults_of_the_library():
    ode, recurrent = OdeBackend(), RecurrentBackend()
    _, text = run("solve", "--help")
    for default in (ode.method.name, recurrent.order.name, f"{LIMIT:g}", recurrent.limit):
        assert f"[default: ({default})]" in text


def test_solve_reports_and_writes_strict_json_and_the_network(tmp_path):
    result, network = tmp_path / "new" / "result.json", tmp_path / "network.npz"
    code, text = run("solve", *SMALL, "--json", result, "--weights", network)
    assert code == 0
    for row in ("problem", "certified", "simulation error", "settling time", "predicted", "rho"):
        assert row in text
    data = strict(result)
    keys = ["status", "objective", "kkt_residual", "rollout_error", "settling_time", "certified"]
    assert set(keys) <= set(data)
    assert data["status"] == "settled"
    assert data["certified"] is True
    assert data["kkt_residual"] < LARGEST_RESIDUAL
    assert len(data["values"]["x"]) == 6
    assert ann_dc.load(network).stages == 5
    assert sorted(f.name for f in tmp_path.rglob("*.*")) == ["network.npz", "result.json"]


def test_the_same_command_writes_the_same_bytes(tmp_path):
    files = [tmp_path / name for name in ("one.json", "two.json")]
    for file in files:
        run("solve", *SMALL, "--initial-guess", "random", "--seed", 3, "--json", file)
    assert files[0].read_bytes() == files[1].read_bytes()


def test_settings_reach_the_problem(tmp_path):
    file = tmp_path / "result.json"
    code, text = run(
        "solve", "double_integrator", "--set", "dt=0.2", "--horizon", 4, "--q-0", "-1,0",
        "--q-d", "1,free", "--method", "lsoda", "--quiet", "--json", file,
    )  # fmt: skip
    assert (code, text) == (0, "")
    data = strict(file)
    assert data["dt"] == 0.2
    x = data["values"]["x"]
    assert (len(x), x[0], x[-1]) == (5, -1, pytest.approx(1))
    assert data["values"]["v"][-1] > 0.1  # left open, so the mass arrives with speed


def test_the_example_file_is_solved_and_its_settings_change(tmp_path):
    file = tmp_path / "result.json"
    code, text = run("solve", PENDULUM, "--set", "horizon=10", "--q-d", "3,0", "--json", file)
    assert code == 0
    assert "pendulum: 2 states (theta, omega), 1 control (torque), 10 stages" in text
    assert strict(file)["values"]["theta"][-1] == pytest.approx(3, abs=1e-5)


def test_a_run_that_does_not_settle_is_told_with_code_1_and_null(tmp_path):
    file = tmp_path / "result.json"
    code, text = run("solve", *SMALL, "--max-settling", 3, "--json", file)
    assert code == 1
    assert "not certified: the network did not settle" in text
    data = strict(file)
    assert data["settling_time"] is None
    assert data["certified"] is False


@pytest.mark.slow
def test_an_end_that_misses_the_target_is_not_certified(tmp_path):
    """S13 wires no terminal condition: the network settles, but not at q_d."""
    file = tmp_path / "result.json"
    options = ("--form", "S13", "--preconditioner", "multilevel", "--no-verify")
    code, text = run("solve", "car", *options, "--json", file)
    assert code == 1
    assert "not certified: the KKT residual" in text
    data = strict(file)
    assert (data["status"], data["certified"]) == ("settled", False)
    assert data["rollout_error"] > 0.9  # of the scale of y, which is its whole way


@pytest.mark.sampled(3)
@pytest.mark.parametrize(
    ("options", "how"),
    [
        ([], "simultaneous order, adaptive steps"),
        (["--order", "two-phase"], "two-phase order, adaptive steps"),
        (["--order", "stage by stage"], "stage-by-stage order"),
        (["--order", "Stage-by-Stage", "--step", "adaptive"], "stage-by-stage order"),
        (["--accelerate", "--max-steps", "1000"], "adaptive steps, Anderson acceleration"),
        (["--step", "0.1"], "simultaneous order, steps of 0.1"),
    ],
)
def test_recurrent_layers_settle_to_the_optimum_and_tell_their_steps(tmp_path, options, how):
    file = tmp_path / "result.json"
    code, text = run("solve", *RECURRENT, *options, "--json", file)
    assert code == 0
    assert how in text
    assert "recurrent steps of" in text
    assert "note:" not in text
    assert strict(file)["objective"] == pytest.approx(500, rel=1e-6)  # least effort: closed form


def test_acceleration_takes_fewer_steps():
    steps = [
        int(run("solve", *RECURRENT, *options)[1].split("settling steps ")[1].split()[0])
        for options in ([], ["--accelerate"])
    ]
    assert steps[1] < steps[0]


def test_the_recurrent_limit_counts_steps():
    code, text = run("solve", *RECURRENT, "--max-steps", 7)
    assert code == 1
    assert "not settled within 7 steps (limit)" in text


@pytest.mark.slow
def test_a_step_that_is_too_long_is_noted_in_a_line_on_stderr():
    words = ["solve", *RECURRENT, "--step", "50"]
    code, out, err = terminal(*words, COLUMNS="80")
    assert code == 1
    assert b"the network did not settle" in out
    assert err.startswith(b"note: step 50 is above the stability limit")
    assert err.count(b"\n") == 1
    assert b"Warning" not in err
    assert run(*words, "--quiet") == (1, "")


def test_plot_writes_figures(tmp_path):
    pytest.importorskip("ann_dc.plotting")
    code, text = run("solve", *SMALL, "--figures", tmp_path / "figures")
    assert code == 0
    figures = list((tmp_path / "figures").iterdir())
    assert figures
    assert all(figure.name in text.replace(" ", "") for figure in figures)


def test_curves_and_the_whole_solution_are_written_and_shown_again(tmp_path):
    curves, saved = tmp_path / "new" / "curves.npz", tmp_path / "new" / "saved"
    code, text = run("solve", *SMALL, "--trajectory", curves, "--save", saved)
    assert code == 0
    assert text.count("wrote") == 2
    again = ann_dc.load_solution(saved)
    with np.load(curves) as file:
        np.testing.assert_array_equal(file["u.a"], again.trajectory["u.a"])
    code, shown = run("show", saved)
    assert code == 0
    table = text.partition(" wrote ")[0]
    assert " ".join(shown.split()) == " ".join(table.split())
    assert "tau da/ds" in run("show", saved, "--equations")[1]


def test_solve_json_dash_prints_only_json():
    code, text = run("solve", *SMALL, "--json", "-")
    assert code == 0
    data = json.loads(text)
    assert data["certified"] is True
    assert run("solve", *SMALL, "--json", "-", "--quiet") == (code, text)


def test_solve_dash_is_refused_for_other_files():
    refused(["solve", *SMALL, "--weights", "-"], "--weights: expected a name that ends in .npz or")
    refused(["solve", *SMALL, "--save", "-"], "--save: expected a folder, got '-'")


@pytest.mark.sampled(2)
@pytest.mark.parametrize("rows", ["short", "all", "none"])
def test_solve_table_shows_the_requested_rows(rows, tmp_path):
    words = ["double_integrator", "-N", "20", "--no-verify", "--save", tmp_path / "saved"]
    code, text = run("solve", *words, "--table", rows)
    assert code == 0
    assert ("x (m)" in text.split("rho")[1]) == (rows != "none")
    assert ("all stages: --table all" in text) == (rows == "short")
    assert run("show", tmp_path / "saved", "--table", rows)[1] == text.partition(" wrote ")[0]


@pytest.mark.parametrize("command", ["solve", "show"])
def test_unknown_rows_of_the_table_are_refused(command):
    refused([command, "car", "--table", "some"], "choose one of: short, all, none")


def test_solve_overwrite_replaces_a_saved_solution_only(tmp_path):
    saved = tmp_path / "saved"
    words = ["solve", *SMALL, "--quiet", "--save", saved]
    assert run(*words) == (0, "")
    refused(words, "use overwrite=True or --overwrite")
    (saved / "note.txt").write_text("mine")
    assert run(*words, "--q-d", "2,0", "--overwrite") == (0, "")
    assert ann_dc.load_solution(saved)["x"][-1] == pytest.approx(2)
    assert not (saved / "note.txt").exists()
    assert [*tmp_path.iterdir()] == [saved]


def test_solve_writes_the_trajectory_as_parquet(tmp_path):
    parquet = pytest.importorskip("pyarrow.parquet")
    files = tmp_path / "a.parquet", tmp_path / "a.npz"
    for file in files:
        assert run("solve", *SMALL, "--quiet", "--trajectory", file) == (0, "")
    table = parquet.read_table(files[0])
    with np.load(files[1]) as arrays:
        np.testing.assert_array_equal(table["u.a[0]"].to_numpy(), arrays["u.a"][:, 0])
    assert json.loads(table.schema.metadata[b"ann_dc.units"])["u.a[0]"] == "m/s^2"


def test_parquet_without_pyarrow_is_refused_before_the_run(tmp_path, monkeypatch):
    monkeypatch.setattr("ann_dc.solver.solve", lambda *_, **__: pytest.fail("ran all the same"))
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    words = ["solve", *SMALL, "--trajectory", tmp_path / "a.parquet"]
    refused(
        words, "a Parquet file needs pyarrow, which is not installed: pip install 'ann-dc[study]'"
    )


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--trajectory", "curves.xlsx"), "name that ends in .csv, .npz or .parquet"),
        (("--trajectory", "curves"), "name that ends in .csv, .npz or .parquet"),
        (("--trajectory", "folder.csv"), "is a folder"),
        (("--trajectory", "file/curves.csv"), "cannot be written"),
        (("--save", "folder"), "exists already"),
        (("--save", "folder.csv"), "exists already"),
        (("--save", "file"), "exists already"),
        (("--save", "file", "--overwrite"), "is not a saved solution"),
        (("--save", "folder", "--overwrite"), "is not a saved solution"),
        (("--save", "network.npz"), "--save: expected a folder"),
        (("--weights", "network.txt"), "--weights: expected a name that ends in .npz or"),
    ],
)
def test_files_that_cannot_be_written_are_told_before_the_run(
    tmp_path, monkeypatch, options, message
):
    monkeypatch.setattr("ann_dc.solver.solve", lambda *_, **__: pytest.fail("ran all the same"))
    monkeypatch.chdir(tmp_path)
    (tmp_path / "folder").mkdir()
    (tmp_path / "folder.csv").mkdir()
    (tmp_path / "file").write_text("kept")
    code, text = run("solve", *SMALL, *options)
    assert code == 2
    assert message in text
    assert {p.name for p in tmp_path.iterdir()} == {"folder", "folder.csv", "file"}


def test_a_folder_that_may_not_be_written_to_is_told_before_the_run(tmp_path, monkeypatch):
    monkeypatch.setattr("ann_dc.solver.solve", lambda *_, **__: pytest.fail("ran all the same"))
    monkeypatch.setattr("os.access", lambda *_: False)
    for options in (("--trajectory", tmp_path / "a.csv"), ("--save", tmp_path / "a")):
        code, text = run("solve", *SMALL, *options)
        assert code == 2
        assert "cannot be written" in text


@pytest.mark.parametrize("option", ["--json", "--save", "--figures", "--trajectory", "--weights"])
def test_unwritable_output_is_told_before_the_run(tmp_path, option, monkeypatch):
    monkeypatch.setattr("ann_dc.solver.solve", lambda *_, **__: pytest.fail("ran all the same"))
    blocked = tmp_path / "file"
    blocked.write_text("kept")
    code, text = run(
        "solve", *SMALL, option, blocked / ("a.npz" if option == "--weights" else "result.csv")
    )
    assert code == 2
    assert "cannot be written" in text
    assert blocked.read_text() == "kept"


def test_a_folder_is_no_json_file(tmp_path):
    code, text = run("solve", *SMALL, "--json", tmp_path)
    assert (code, "is a folder" in text) == (2, True)


@pytest.mark.slow
def test_a_terminal_without_utf8_shows_plain_letters(tmp_path):
    file = tmp_path / "swing.toml"
    text = PENDULUM.read_text(encoding="utf-8").replace('name = "pendulum"', 'name = "péndulo"')
    file.write_text(text, encoding="utf-8")
    plain = {"PYTHONIOENCODING": "ascii", "NO_COLOR": "1", "COLUMNS": "80"}
    code, out, err = terminal("solve", file, "-N", 10, "--q-d", "3,0", "--no-verify", **plain)
    assert (code, err) == (0, b"")
    assert b"p?ndulo" in out
    assert max(map(len, out.splitlines())) <= 80


def test_without_torch_a_sentence_says_how_to_get_it(monkeypatch):
    forget_torch(monkeypatch)
    code, text = run("solve", *RECURRENT, "--accelerate")
    assert code == 2
    assert "--accelerate: recurrent layers need torch" in text
    assert "pip install 'ann-dc[torch]'" in text


def test_without_torch_recurrent_steps_are_taken_in_code(monkeypatch):
    forget_torch(monkeypatch)
    assert run("solve", *RECURRENT)[0] == 0
    monkeypatch.setattr(
        recurrent_backend, "refusal", lambda _: "no code"
    )  # as of a cell of many blocks
    code, text = run("solve", *RECURRENT)
    assert code == 2
    assert "--backend recurrent: recurrent layers need torch" in text


BAD = {
    "negative seed": (["solve", "car", "--seed", "-1"], "--seed"),
}


@pytest.mark.parametrize(("words", "meaning"), BAD.values(), ids=BAD)
def test_bad_input_is_told_in_a_sentence_with_code_2(words, meaning):
    refused(words, meaning)


def test_many_starts(tmp_path):
    result, network = tmp_path / "result.json", tmp_path / "network.npz"
    words = (
        "double_integrator",
        "-N",
        "5",
        "--starts",
        "3",
        "--json",
        result,
        "--weights",
        network,
    )
    code, text = run("solve", *words)
    assert code == 0
    assert "1 certified optimum from 3 starts" in text
    assert "two-phase order" in text
    data = strict(result)
    assert data["certified"] is True
    (optimum,) = data["multistart"]["optima"]
    assert optimum["starts"] == [0, 1, 2]
    assert ann_dc.load(network).stages == 5


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--starts", "0"), "--starts"),
        (("--starts", "-2"), "--starts"),
        (("--starts", "many"), "--starts"),
        (
            ("--starts", "2", "--initial-guess", "zero"),
            "--starts: cannot be combined with --initial-guess",
        ),
        (("--starts", "2", "--form", "printed"), "--starts: cannot be combined with --form"),
        (("--starts", "2", "--refine"), "--starts: cannot be combined with --refine"),
        (("--starts", "2", "--max-settling", "9"), "--max-settling: belongs to --backend ode"),
        (("--starts", "2", "--method", "RK45"), "--method: belongs to --backend ode"),
        (("--starts", "2", "--backend", "spice"), "--backend"),
    ],
)
def test_many_starts_that_are_refused(words, message):
    code, text = run("solve", "double_integrator", "-N", "5", *words)
    assert code == 2
    assert message in text
