"""Solving from the command line: reports, files, exit codes, recurrent layers."""

import sys

import pytest
from command_line import PENDULUM, RECURRENT, SMALL, refused, run, strict, terminal

import ann_dc
from ann_dc.backends import OdeBackend
from ann_dc.backends.recurrent import RecurrentBackend
from ann_dc.optimality import LARGEST_RESIDUAL


def test_help_tells_the_defaults_of_the_library():
    ode, recurrent = OdeBackend(), RecurrentBackend()
    _, text = run("solve", "--help")
    for default in (ode.method.name, recurrent.order.name, f"{ode.limit:g} or {recurrent.limit}"):
        assert f"[default: ({default})]" in text


def test_solve_reports_and_writes_strict_json_and_the_network(tmp_path):
    result, network = tmp_path / "new" / "result.json", tmp_path / "network.npz"
    code, text = run("solve", *SMALL, "--json", result, "--save", network)
    assert code == 0
    for row in ("problem", "certified", "roll-out", "settling time", "predicted", "rho"):
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
        run("solve", *SMALL, "--start", "random", "--seed", 3, "--json", file)
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
    assert "pendulum: 2 states (theta, omega), 1 controls (torque), 10 stages" in text
    assert strict(file)["values"]["theta"][-1] == pytest.approx(3, abs=1e-5)


def test_a_run_that_does_not_settle_is_told_with_code_1_and_null(tmp_path):
    file = tmp_path / "result.json"
    code, text = run("solve", *SMALL, "--limit", 3, "--json", file)
    assert code == 1
    assert "no: the network did not settle" in text
    data = strict(file)
    assert data["settling_time"] is None
    assert data["certified"] is False


def test_an_end_that_misses_the_target_is_not_certified(tmp_path):
    """S13 wires no terminal condition: the network settles, but not at q_d."""
    file = tmp_path / "result.json"
    options = ("--form", "S13", "--kinds", "pyramid", "--no-verify")
    code, text = run("solve", "car", *options, "--json", file)
    assert code == 1
    assert "no: the KKT residual" in text
    data = strict(file)
    assert (data["status"], data["certified"]) == ("settled", False)
    assert data["rollout_error"] > 1


@pytest.mark.parametrize(
    ("options", "how"),
    [
        ([], "simultaneous order, adaptive steps"),
        (["--order", "two-phase"], "two-phase order, adaptive steps"),
        (["--order", "stage by stage"], "stage-by-stage order"),
        (["--order", "Stage-by-Stage", "--step", "adaptive"], "stage-by-stage order"),
        (["--accelerate", "--limit", "1e3"], "adaptive steps, Anderson acceleration"),
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
    code, text = run("solve", *RECURRENT, "--limit", 7)
    assert code == 1
    assert "7 steps were done (limit)" in text


def test_a_step_that_is_too_long_is_noted_in_a_line_on_stderr():
    words = ["solve", *RECURRENT, "--step", "50"]
    code, out, err = terminal(*words, COLUMNS="80")
    assert code == 1
    assert b"the network did not settle" in out
    assert err.startswith(b"note: step 50 is above the stability limit")
    assert err.count(b"\n") == 1
    assert b"Warning" not in err
    assert terminal(*words, "--quiet") == (1, b"", b"")


def test_plot_writes_figures(tmp_path):
    pytest.importorskip("ann_dc.plotting")
    code, text = run("solve", *SMALL, "--plot", tmp_path / "figures")
    assert code == 0
    figures = list((tmp_path / "figures").iterdir())
    assert figures
    assert all(figure.name in text.replace(" ", "") for figure in figures)


@pytest.mark.parametrize("option", ["--json", "--save", "--plot"])
def test_unwritable_output_is_told_before_the_run(tmp_path, option, monkeypatch):
    monkeypatch.setattr("ann_dc.solver.solve", lambda *_, **__: pytest.fail("ran all the same"))
    blocked = tmp_path / "file"
    blocked.write_text("kept")
    code, text = run("solve", *SMALL, option, blocked / "result")
    assert code == 2
    assert "cannot be written" in text
    assert blocked.read_text() == "kept"


def test_a_folder_is_no_json_file(tmp_path):
    code, text = run("solve", *SMALL, "--json", tmp_path)
    assert (code, "is a folder" in text) == (2, True)


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
    rooms = ("ann_dc.backends.recurrent", "ann_dc.two_level", "ann_dc.report.coordination")
    for module in [name for name in sys.modules if name.startswith(rooms)]:
        monkeypatch.delitem(sys.modules, module)
    monkeypatch.setitem(sys.modules, "torch", None)
    code, text = run("solve", *RECURRENT)
    assert code == 2
    assert "pip install 'ann-dc[torch]'" in text


BAD = {
    "negative seed": (["solve", "car", "--seed", "-1"], "--seed"),
}


@pytest.mark.parametrize(("words", "meaning"), BAD.values(), ids=BAD)
def test_bad_input_is_told_in_a_sentence_with_code_2(words, meaning):
    refused(words, meaning)
