"""The command line: every command, its exit code, its files, and every kind of bad input."""

import json
import os
import signal
import subprocess
import sys
import time
from inspect import signature
from pathlib import Path
from statistics import median

import pytest
from typer.testing import CliRunner

import ann_dc
from ann_dc import cli
from ann_dc.backends.ode import OdeBackend
from ann_dc.certificate import LARGEST_RESIDUAL
from ann_dc.cli.problem import defaults_of
from ann_dc.cli.words import as_typed, backend_of, value_of
from ann_dc.problem import plants

ROOT = Path(__file__).parent.parent
PENDULUM = ROOT / "demos" / "pendulum.toml"
SMALL = ["double_integrator", "-N", "5", "--no-verify"]


def run(*words):
    """Exit code and everything printed, without rules, runs of blanks as one."""
    plain = {"COLUMNS": "80", "NO_COLOR": "1", "TERM": "dumb"}
    result = CliRunner().invoke(cli.app, [str(word) for word in words], env=plain)
    assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
    return result.exit_code, " ".join(result.output.replace("│", " ").split())


def terminal(*words, **environment):
    """The same in a process of its own: exit code, stdout, stderr."""
    done = subprocess.run(
        [sys.executable, "-m", "ann_dc", *map(str, words)],
        cwd=ROOT, capture_output=True, timeout=120, env={**os.environ, **environment},
    )  # fmt: skip
    return done.returncode, done.stdout, done.stderr


def strict(file):
    def refuse(constant):
        raise AssertionError(f"{constant} is not JSON")

    return json.loads(Path(file).read_text(encoding="utf-8"), parse_constant=refuse)


# ---- what it shows -----------------------------------------------------------------------------


def test_version_and_help_name_every_command():
    assert run("--version") == (0, f"ann-dc {ann_dc.__version__}")
    code, text = run("--help")
    assert code == 0
    assert all(command in text for command in ("solve", "show", "plants", "paper"))


@pytest.mark.parametrize("command", ["solve", "show", "plants", "paper"])
def test_help_of_a_command_has_an_example_and_units(command):
    code, text = run(command, "--help")
    assert code == 0
    assert f"ann-dc {command} " in text.split("Example", 1)[1]
    assert any(unit in text for unit in ("seconds", "units", "time constants"))


def test_plants_lists_every_plant():
    code, text = run("plants")
    assert code == 0
    assert all(name in text for name in plants.names())
    assert ":math:" not in text


@pytest.mark.parametrize("name", plants.names())
def test_a_plant_shows_its_parameters_and_they_can_be_typed_back(name):
    code, text = run("plants", name)
    assert code == 0
    for parameter, default in defaults_of(plants.get(name)).items():
        assert parameter in text
        typed = value_of(parameter, as_typed(default), default)
        assert typed == pytest.approx(default)


def test_show_gives_equations_and_counts_by_default():
    code, text = run("show", "car")
    assert code == 0
    assert "tau deta/ds" in text
    assert "multipliers" in text


@pytest.mark.parametrize(
    ("options", "there", "not_there"),
    [
        (["--equations"], "tau deta/ds", "multipliers"),
        (["--counts"], "multipliers", "tau deta/ds"),
        (["--latex"], r"\begin{align*}", "multipliers"),
        (["--cell"], "u.nu times cos(phi)", "multipliers"),
        (["--cell"], "q.x of cell 0 is the input q_0.x", "tau deta/ds"),
        (["--form", "s8", "--equations"], "with S8", "corrected"),
        (["--set", "D=0.5", "--equations"], "0.2*nu*tan(varphi)", "0.1*nu*tan(varphi)"),
    ],
)
def test_show_options(options, there, not_there):
    code, text = run("show", "car", *options)
    assert code == 0
    assert there in text
    assert not_there not in text


# ---- what it solves ----------------------------------------------------------------------------


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


def test_without_options_the_library_decides_how_it_runs():
    default = signature(cli.solve.solve).parameters
    backend = backend_of(
        default["backend"].default, method=default["method"].default, limit=default["limit"].default
    )
    assert (backend.method, backend.limit) == (OdeBackend().method, OdeBackend().limit)


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
    code, text = run("solve", "car", "--form", "S13", "--no-verify", "--json", file)
    assert code == 1
    assert "no: the KKT residual" in text
    data = strict(file)
    assert (data["status"], data["certified"]) == ("settled", False)
    assert data["rollout_error"] > 1


def test_plot_writes_figures(tmp_path):
    pytest.importorskip("ann_dc.plotting")
    code, text = run("solve", *SMALL, "--plot", tmp_path / "figures")
    assert code == 0
    figures = list((tmp_path / "figures").iterdir())
    assert figures
    assert all(figure.name in text.replace(" ", "") for figure in figures)


def test_paper_certifies_both_cars_and_shows_the_slips(tmp_path):
    pytest.importorskip("ann_dc.plotting")
    code, text = run("paper", "--out", tmp_path)
    assert code == 0
    data = strict(tmp_path / "result.json")
    assert data["corrected D=1"]["objective"] == pytest.approx(398.6315, abs=1e-3)
    assert data["corrected D=0.5"]["objective"] == pytest.approx(368.1893, abs=1e-3)
    assert data["printed D=1"]["status"] == "diverged"
    assert data["plain D=1"]["status"] == "left_domain"
    assert "u[8].nu" in text
    assert "started 1% off the optimum" in text
    assert "398.6315" in text
    assert "368.1893" in text
    assert list(tmp_path.rglob("*.png"))


# ---- bad input ---------------------------------------------------------------------------------

BAD = {
    "unknown plant": (["solve", "cra"], "did you mean car"),
    "unknown plant to show": (["show", "unicicle"], "did you mean unicycle"),
    "unknown plant to list": (["plants", "pendulun"], "did you mean pendulum"),
    "no value": (["solve", "car", "--set", "D"], "--set: expected NAME=VALUE"),
    "unknown parameter": (["solve", "car", "--set", "E=1"], "c_over_m, gamma, dt, N, q_0, q_d"),
    "given twice": (["solve", "car", "-N", "3", "--set", "N=4"], "N: given twice"),
    "code": (["solve", "car", "--set", "D=__import__('os')"], "D: expected a finite number"),
    "nan": (["solve", "car", "--set", "D=nan"], "D: expected a finite number"),
    "infinite": (["solve", "car", "--q-0", "inf,0,0,0"], "q_0: expected a finite number"),
    "too many": (["solve", "car", "--q-d", "1,2,3,4,5"], "q_d: expected 4 numbers"),
    "free start": (["solve", "car", "--q-0", "free,0,0,0"], "q_0: expected a finite number"),
    "half a stage": (["solve", "car", "--set", "N=2.5"], "N: expected a whole number"),
    "no stage": (["solve", "car", "-N", "0"], "horizon: expected a whole number of stages"),
    "no wheel base": (["solve", "car", "--set", "D=0"], "car with D=0"),
    "bad seed": (["solve", "lq", "--set", "seed=-1"], "lq with seed=-1"),
    "huge": (["solve", "car", "--q-d", "1e300,1,0,0"], "q_d: 1e300 is too large"),
    "huge wheel base": (["solve", "car", "--set", "D=-1e300"], "D: -1e300 is too large"),
    "unknown backend": (["solve", "car", "--backend", "spice"], "ode"),
    "unknown method": (["solve", "car", "--method", "Euler"], "RK23, RK45, DOP853, Radau, BDF"),
    "unknown form": (["solve", "car", "--form", "S17"], "corrected, printed, S1"),
    "unknown form to show": (["show", "car", "--form", "x"], "corrected, printed, S1"),
    "unknown start": (["solve", "car", "--start", "here"], "line, zero, random"),
    "negative seed": (["solve", "car", "--seed", "-1"], "--seed"),
    "no limit": (["solve", "car", "--limit", "nan"], "--limit: expected a positive number"),
    "missing file": (["solve", "missing.toml"], "does not exist"),
    "folder": (["solve", str(ROOT)], "is a folder"),
    "file parameter": (["solve", str(PENDULUM), "--set", "effort=1"], "q_0, q_d, horizon, dt"),
    "no problem": (["solve"], "PROBLEM"),
    "no such command": (["slove"], "slove"),
}


@pytest.mark.parametrize(("words", "told"), BAD.values(), ids=BAD)
def test_bad_input_is_told_in_a_sentence_with_code_2(words, told):
    code, text = run(*words)
    assert code == 2
    assert told in text
    assert "Traceback" not in text


@pytest.mark.parametrize(
    ("cost", "told"),
    [
        ('"torque**2', "not valid TOML"),
        ("\"__import__('os').system('touch pwned')\"", "cost"),
        ("nan", "cost"),
        ('"speed**2"', "speed"),
    ],
)
def test_a_bad_file_is_told_with_its_name_and_never_executed(tmp_path, monkeypatch, cost, told):
    monkeypatch.chdir(tmp_path)
    file = tmp_path / "bad.toml"
    text = PENDULUM.read_text(encoding="utf-8")
    file.write_text(text.replace('"effort * torque**2"', cost), encoding="utf-8")
    code, text = run("solve", file)
    assert code == 2
    assert told in text
    assert "bad.toml" in text
    assert list(tmp_path.iterdir()) == [file]


@pytest.mark.parametrize("option", ["--json", "--save", "--plot"])
def test_unwritable_output_is_told_before_the_run(tmp_path, option, monkeypatch):
    monkeypatch.setattr(cli.solve, "solved", lambda *_, **__: pytest.fail("ran all the same"))
    blocked = tmp_path / "file"
    blocked.write_text("kept")
    code, text = run("solve", *SMALL, option, blocked / "result")
    assert code == 2
    assert "cannot be written" in text
    assert blocked.read_text() == "kept"


def test_a_folder_is_no_json_file_and_a_file_no_output_folder(tmp_path):
    code, text = run("solve", *SMALL, "--json", tmp_path)
    assert (code, "is a folder" in text) == (2, True)
    blocked = tmp_path / "file"
    blocked.write_text("kept")
    code, text = run("paper", "--out", blocked)
    assert (code, "cannot be written" in text) == (2, True)


# ---- in a terminal -----------------------------------------------------------------------------


def test_a_terminal_without_utf8_shows_plain_letters(tmp_path):
    file = tmp_path / "swing.toml"
    text = PENDULUM.read_text(encoding="utf-8").replace('name = "pendulum"', 'name = "péndulo"')
    file.write_text(text, encoding="utf-8")
    plain = {"PYTHONIOENCODING": "ascii", "NO_COLOR": "1", "COLUMNS": "80"}
    code, out, err = terminal("solve", file, "-N", 10, "--q-d", "3,0", "--no-verify", **plain)
    assert (code, err) == (0, b"")
    assert b"p?ndulo" in out
    assert max(map(len, out.splitlines())) <= 80
    code, out, err = terminal("plants", **plain)
    assert (code, err, out.isascii()) == (0, b"", True)


def test_errors_go_to_stderr():
    code, out, err = terminal("solve", "cra")
    assert (code, out) == (2, b"")
    assert err.startswith(b"error: there is no plant 'cra'; did you mean car")
    assert err.count(b"\n") == 1


@pytest.mark.skipif(os.name == "nt", reason="needs POSIX signals")
def test_an_interrupt_ends_quietly_with_130():
    words = [sys.executable, "-c", INTERRUPTIBLE, "solve", "car"]
    process = subprocess.Popen(words, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    assert process.stdout is not None
    assert process.stdout.readline() == b"running\n"
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=60)
    assert (process.returncode, out, err) == (130, b"", b"")


INTERRUPTIBLE = """
import time
from ann_dc import cli
from ann_dc.backends.ode import OdeBackend
def forever(*_, **__):
    print("running", flush=True)
    time.sleep(60)
cli.solve.solved = forever
cli.main()
"""


def test_importing_the_command_line_is_fast_and_loads_no_solver():
    probe = (
        "import sys, ann_dc.cli; "
        "print([m for m in ('numpy', 'scipy', 'sympy', 'numba', 'matplotlib') if m in sys.modules])"
    )
    loading, bare = started(probe), started("print([])")
    assert {out for _, out in loading} == {"[]"}
    assert median(took for took, _ in loading) < median(took for took, _ in bare) + 1


def started(script, times=3):
    """Seconds, and what was printed, of one fresh interpreter after the other."""
    runs = []
    for _ in range(times):
        began = time.perf_counter()
        done = subprocess.run(
            [sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True, check=True
        )
        runs.append((time.perf_counter() - began, done.stdout.strip()))
    return runs
