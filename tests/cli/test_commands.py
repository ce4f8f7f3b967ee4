"""The command line: every command, its exit code, its files, and every kind of bad input."""

import json
import os
import signal
import subprocess
import sys
import time
import warnings
from inspect import signature
from pathlib import Path
from statistics import median

import pytest
from simulator import needs_ngspice
from typer.testing import CliRunner

import ann_dc
from ann_dc import cli
from ann_dc.backends.ode import OdeBackend
from ann_dc.backends.settling import Settling
from ann_dc.cli.arguments.backends import BACKENDS, backend_of
from ann_dc.cli.arguments.numbers import as_typed, value_of
from ann_dc.cli.arguments.problem import defaults_of
from ann_dc.cli.terminal import notes
from ann_dc.optimality.certificate import LARGEST_RESIDUAL
from ann_dc.problem import plants

ROOT = Path(__file__).parents[2]
PENDULUM = ROOT / "demos" / "pendulum.toml"
SMALL = ["double_integrator", "-N", "5", "--no-verify"]
RECURRENT = ["double_integrator", "-N", "5", "--backend", "recurrent"]
COORDINATE = ["coordinate", "double_integrator", "-N", "5"]


COMMANDS = ["solve", "coordinate", "circuit", "show", "plants", "paper"]


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
    assert all(command in text for command in COMMANDS)


@pytest.mark.parametrize("command", COMMANDS)
def test_help_of_a_command_has_an_example_and_units(command):
    code, text = run(command, "--help")
    assert code == 0
    assert f"ann-dc {command} " in text.split("Example", 1)[1]
    assert any(unit in text for unit in ("seconds", "units", "time constants"))


def test_help_tells_the_defaults_of_the_library():
    from ann_dc.backends.recurrent.backend import RecurrentBackend

    ode, recurrent = OdeBackend(), RecurrentBackend()
    _, text = run("solve", "--help")
    for default in (ode.method.name, recurrent.order.name, f"{ode.limit:g} or {recurrent.limit}"):
        assert f"[default: ({default})]" in text
    _, text = run("coordinate", "--help")
    assert f"{Settling().confirm:g} of it" in text


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


@pytest.mark.parametrize("backend", BACKENDS)
def test_without_options_the_library_decides_how_it_runs(backend):
    default = {name: p.default for name, p in signature(cli.solve.solve).parameters.items()}
    assert default["backend"] == "ode"
    options = {name: default[name] or None for names in BACKENDS.values() for name in names}
    built = backend_of(backend, limit=default["limit"], **options)
    expected = type(built)()
    assert all(getattr(built, f) == getattr(expected, f) for f in ("limit", *SHARED[backend]))


SHARED = {"ode": ("method", "verify"), "recurrent": ("order", "step", "acceleration")}
"""Fields of a backend that options of the command line set."""


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


def test_what_the_library_warns_of_becomes_one_note_a_sentence(capsys):
    with notes():
        for _ in range(2):
            warnings.warn("too\nlong", UserWarning, stacklevel=1)
    assert capsys.readouterr().err == "note: too long\n"


def test_other_warnings_stay_what_they_are():
    with pytest.warns(RuntimeWarning, match="overflow"), notes():
        warnings.warn("overflow", RuntimeWarning, stacklevel=1)


@pytest.mark.parametrize(
    ("coordinator", "lower"),
    [("gradient", "closed"), ("newton", "linearised"), ("newton", "closed")],
)
def test_coordinate_settles_to_the_optimum(tmp_path, coordinator, lower):
    file = tmp_path / "result.json"
    chosen = [] if lower == "linearised" else ["--lower", lower]
    code, text = run(*COORDINATE, "--coordinator", coordinator, *chosen, "--json", file)
    assert code == 0
    for row in ("the hypothesis of Theorem IV.2", "outer iterations", "inner steps", "Theta"):
        assert row in text
    data = strict(file)
    assert (data["coordinator"], data["lower_level"]) == (coordinator, lower)
    assert (data["status"], data["certified"]) == ("settled", True)
    assert data["objective"] == pytest.approx(500, rel=1e-6)
    assert data["values"]["a"] == pytest.approx([20, 10, 0, -10, -20], abs=1e-3)
    assert [data["values"][name][-1] for name in ("x", "v")] == pytest.approx([1, 0])
    assert len(data["theta"]) == data["outer_iterations_in_all"] + 1 == len(data["residuals"])
    assert data["theta"][-1] < 1e-9 * data["theta"][0]


def test_coordinate_predicts_what_the_gradient_coordinator_needs(tmp_path):
    """The slowest mode alone: what else starts makes the count another one, not by much."""
    file = tmp_path / "result.json"
    code, text = run("coordinate", "car", "--json", file)
    assert code == 0
    data = strict(file)
    assert data["objective"] == pytest.approx(398.6315, abs=1e-3)
    assert data["predicted_outer_iterations"] == pytest.approx(data["outer_iterations"], rel=0.2)
    assert f"{data['predicted_outer_iterations']:.0f}, from the spectral radius" in text
    assert f"{data['outer_iterations']} until the residual stays below 1e-06" in text
    assert f"lambda_t = {data['lambda_t']:.4g}, lambda_beta = {data['lambda_beta']:.4g}" in text
    assert data["theorem_IV_2_holds"] is False
    assert data["theta_fell_monotonically"] is True
    assert "fell in all" in text


@pytest.mark.parametrize(
    "options", [["--coordinator", "oracle"], ["--lower", "iterated"], ["--tolerance", "1e-8"]]
)
def test_coordinate_that_is_not_done_is_told_with_code_1(tmp_path, options):
    file = tmp_path / "result.json"
    code, text = run(*COORDINATE, *options, "--limit", 9, "--json", file)
    assert code == 1
    assert "not settled after 9 outer iterations" in text
    assert "no: the two levels did not settle" in text
    data = strict(file)
    assert (data["status"], data["certified"]) == ("not_settled", False)
    assert data["outer_iterations"] is None
    assert len(data["theta"]) == 10


def test_coordinate_needs_a_design_that_settled(tmp_path):
    """One stage cannot bring a mass to rest anywhere."""
    file = tmp_path / "result.json"
    code, text = run("coordinate", "double_integrator", "-N", 1, "--json", file)
    assert code == 1
    assert "the design did not settle" in text
    data = strict(file)
    assert (data["status"], data["certified"]) == ("design_not_settled", False)
    quiet = run("coordinate", "double_integrator", "-N", 1, "--quiet")
    assert quiet == (1, "")


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
    "recurrent method": (["solve", *RECURRENT, "--method", "RK45"], "--method: belongs to"),
    "recurrent verify": (["solve", *RECURRENT, "--verify"], "--verify: belongs to --backend ode"),
    "recurrent no verify": (["solve", *RECURRENT, "--no-verify"], "--no-verify: belongs to"),
    "ode order": (["solve", "car", "--order", "two-phase"], "--order: belongs to"),
    "ode step": (["solve", "car", "--step", "adaptive"], "--step: belongs to"),
    "ode accelerate": (["solve", "car", "--accelerate"], "or say --backend recurrent"),
    "unknown order": (["solve", *RECURRENT, "--order", "x"], "two-phase, stage-by-stage"),
    "step of no time": (["solve", *RECURRENT, "--step", "0"], "--step: expected a positive number"),
    "step that is nan": (["solve", *RECURRENT, "--step", "nan"], "--step: expected a positive"),
    "unknown step": (["solve", *RECURRENT, "--step", "long"], "or adaptive, got 'long'"),
    "half a step": (["solve", *RECURRENT, "--limit", "2.5"], "a whole number of steps, got 2.5"),
    "no steps": (["solve", *RECURRENT, "--limit", "0"], "--limit: expected a positive number"),
    "unknown plant to coordinate": (["coordinate", "cra"], "did you mean car"),
    "unknown coordinator": ([*COORDINATE, "--coordinator", "x"], "gradient, newton, oracle"),
    "unknown lower level": ([*COORDINATE, "--lower", "x"], "closed, iterated"),
    "no outer iterations": ([*COORDINATE, "--limit", "0"], "--limit"),
    "no tolerance": ([*COORDINATE, "--tolerance", "0"], "--tolerance: expected a number below 1"),
    "tolerance nan": ([*COORDINATE, "--tolerance", "nan"], "--tolerance: expected a number"),
    "folder to coordinate into": ([*COORDINATE, "--json", str(ROOT)], "is a folder"),
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


@pytest.mark.parametrize(("words", "meaning"), BAD.values(), ids=BAD)
def test_bad_input_is_told_in_a_sentence_with_code_2(words, meaning):
    code, text = run(*words)
    assert code == 2
    assert meaning in text
    assert "Traceback" not in text


@pytest.mark.parametrize(
    ("cost", "meaning"),
    [
        ('"torque**2', "not valid TOML"),
        ("\"__import__('os').system('touch pwned')\"", "cost"),
        ("nan", "cost"),
        ('"speed**2"', "speed"),
    ],
)
def test_a_bad_file_is_told_with_its_name_and_never_executed(tmp_path, monkeypatch, cost, meaning):
    monkeypatch.chdir(tmp_path)
    file = tmp_path / "bad.toml"
    text = PENDULUM.read_text(encoding="utf-8")
    file.write_text(text.replace('"effort * torque**2"', cost), encoding="utf-8")
    code, text = run("solve", file)
    assert code == 2
    assert meaning in text
    assert "bad.toml" in text
    assert list(tmp_path.iterdir()) == [file]


@pytest.mark.parametrize("words", [["solve", *RECURRENT], COORDINATE])
def test_without_torch_a_sentence_says_how_to_get_it(words, monkeypatch):
    rooms = ("ann_dc.backends.recurrent", "ann_dc.two_level", "ann_dc.report.coordination")
    for module in [name for name in sys.modules if name.startswith(rooms)]:
        monkeypatch.delitem(sys.modules, module)
    monkeypatch.setitem(sys.modules, "torch", None)
    code, text = run(*words)
    assert code == 2
    assert "pip install 'ann-dc[torch]'" in text


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
@pytest.mark.usefixtures("interruptible")
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
    heavy = ("numpy", "scipy", "sympy", "numba", "matplotlib", "torch")
    probe = f"import sys, ann_dc.cli; print([m for m in {heavy} if m in sys.modules])"
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


# ---- circuits ----------------------------------------------------------------------------------

CIRCUIT = ["circuit", "double_integrator", "-N", "5"]


@needs_ngspice
def test_circuit_settles_near_the_optimum(tmp_path):
    deck, result = tmp_path / "car.cir", tmp_path / "car.json"
    code, text = run("circuit", "car", "--deck", deck, "--json", result)
    assert code == 0
    assert "op amps" in text
    found = strict(result)
    assert found["control_error"] < 1e-4
    assert found["settling_time"] < 40e-6
    assert found["objective"] == pytest.approx(398.6315, rel=1e-3)
    assert deck.read_text(encoding="utf-8").endswith(".end\n")


@needs_ngspice
def test_circuit_on_ideal_parts():
    code, text = run(*CIRCUIT, "--level", "behavioural")
    assert code == 0
    assert "behavioural" in text


@needs_ngspice
@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (("--level", "wood"), "--level"),
        (("--a0", "-1"), "a0"),
        (("--gbw", "0"), "gbw"),
        (("--margin", "nan"), "margin"),
        (("--full-scale", "0"), "full_scale"),
    ],
)
def test_circuit_names_what_is_wrong(arguments, named):
    code, text = run(*CIRCUIT, *arguments)
    assert code == 2
    assert named in text


def test_circuit_without_ngspice_says_what_to_do(monkeypatch):
    monkeypatch.setenv("ANN_DC_NGSPICE", "/nowhere/ngspice")
    code, text = run(*CIRCUIT)
    assert code == 2
    assert "ANN_DC_NGSPICE" in text


QUICK = ["circuit", "double_integrator", "-N", "4"]
LEVELS = ["behavioural", "ota-c", "macro", "differential", "transistor", "tl072_ad633"]


@needs_ngspice
@pytest.mark.parametrize("level", LEVELS)
def test_every_level_has_a_word(tmp_path, level):
    result = tmp_path / "result.json"
    code, text = run(*QUICK, "--level", level.upper(), "--json", result)
    assert code == 0
    assert "controls within 0.1 %" in text
    found = strict(result)
    assert found["level"] == {"differential": "macro, differential"}.get(level, level)
    assert found["settled"]
    assert found["control_error"] < 1e-2
    assert (found["predicted"] is None) == (level == "behavioural")
    assert found["parts"]


@needs_ngspice
def test_switched_capacitors_have_a_word():
    """One stage, from rest to a speed: a period takes as long as a run of another level."""
    words = ["-N", "1", "--set", "dt=1", "--q-0", "0,0", "--q-d", "free,1"]
    code, text = run(*QUICK[:2], *words, "--level", "switched-capacitor")
    assert code == 0
    assert "switches" in text


@needs_ngspice
def test_a_seed_draws_parts_and_a_budget_tells_which_to_pay_for(tmp_path):
    files = [tmp_path / name for name in ("one.json", "again.json", "two.json")]
    words = [*QUICK, "--level", "opa192_ad734", "--budget", "3"]
    outputs = [run(*words, "--seed", seed, "--json", file) for seed, file in zip((1, 1, 2), files)]
    code, text = outputs[0]
    assert code == 0
    assert "parts drawn with seed 1" in text
    assert "what costs most" in text
    assert "resistor from t.x to m.x 0.10%" in text
    one, again, two = map(strict, files)
    assert one == again
    assert one["control_error"] != two["control_error"]
    assert (one["seed"], two["seed"]) == (1, 2)
    assert one["budget"] == two["budget"]  # of the parts as they should be
    assert len(one["budget"]) == 3
    assert {"parameter", "size", "unit", "error", "share_of_variance"} <= one["budget"][0].keys()
    assert one["predicted"]["control_error"] == pytest.approx(one["control_error"], rel=0.01)
    assert one["power"] * one["settling_time"] == pytest.approx(one["energy"])


@needs_ngspice
def test_drawn_circuits_are_predicted(tmp_path):
    result = tmp_path / "result.json"
    words = ["--level", "opa192_ad734", "--samples", "8", "--json", result]
    code, text = run(*QUICK, *words)
    assert code == 0
    assert "95 % of 8 (predicted)" in text
    assert len(strict(result)["samples"]) == 8


@needs_ngspice
def test_circuit_writes_netlist_bill_picture_and_numbers(tmp_path):
    names = {"--deck": "a.cir", "--bill": "b.csv", "--figure": "c.png", "--json": "d.json"}
    files = {option: tmp_path / "new" / name for option, name in names.items()}
    options = [word for pair in files.items() for word in pair]
    code, text = run(*QUICK, "--resistors", "e96-pairs", "--level", "macro", *options)
    assert code == 0
    assert text.count("wrote ") == 4
    assert "E96 pairs: off by up to 0.0" in text
    assert files["--deck"].read_text(encoding="utf-8").endswith(".end\n")
    assert files["--bill"].read_text(encoding="utf-8").startswith("cell,component,")
    assert files["--figure"].read_bytes().startswith(b"\x89PNG")
    assert strict(files["--json"])["resistors"] == "E96 pairs"
    assert {file.name for file in (tmp_path / "new").iterdir()} == set(names.values())


@needs_ngspice
def test_one_resistor_of_a_series_is_worse_than_two(tmp_path):
    errors = []
    for series in ("exact", "E96-pairs", "E24"):
        result = tmp_path / f"{series}.json"
        code, _ = run(*QUICK, "--resistors", series, "--json", result)
        found = strict(result)
        assert code == (0 if found["control_error"] < 1e-2 else 1)
        errors.append(found["control_error"])
    assert errors == sorted(errors)
    assert errors[2] > 10 * errors[1]


CIRCUIT_BAD = {
    "unknown level": (["--level", "wood"], "--level 'wood' does not exist; choose one of: behav"),
    "presets are listed": (["--level", "lm741"], "tl072_ad633"),
    "unknown series": (["--resistors", "E7"], "choose one of: exact, E12, E24, E96, E24-pairs"),
    "a0 of a preset": (["--level", "tl072_ad633", "--a0", "1e5"], "--a0: the parts of level"),
    "gbw of transistors": (["--level", "transistor", "--gbw", "1e6"], "choose them with macro"),
    "a0 of ideal parts": (["--level", "behavioural", "--a0", "1e5"], "--a0: the parts of level"),
    "negative seed": (["--seed", "-1"], "--seed"),
    "half a seed": (["--seed", "1.5"], "--seed"),
    "negative budget": (["--budget", "-1"], "--budget"),
    "ladder and deck": (["--level", "ladder", "--deck", "x.cir"], "--deck: belongs to one level"),
    "ladder and bill": (["--level", "ladder", "--bill", "x.csv"], "--bill: belongs to one level"),
    "ladder and a0": (["--level", "ladder", "--a0", "1e5"], "--a0: belongs to one level"),
    "ladder and series": (["--level", "ladder", "--resistors", "E24"], "--resistors: belongs to"),
    "ladder and budget": (["--level", "ladder", "--budget", "3"], "--budget: belongs to one"),
    "ladder and samples": (["--level", "ladder", "--samples", "3"], "--samples: belongs to one"),
    "ladder and volts": (["--level", "ladder", "--full-scale", "5"], "--full-scale: belongs to"),
    "slow and no ladder": (["--slow"], "--slow: belongs to --level ladder"),
    "a folder": (["--json", str(ROOT)], "is a folder"),
}


@pytest.mark.parametrize(("words", "meaning"), CIRCUIT_BAD.values(), ids=CIRCUIT_BAD)
def test_bad_options_of_a_circuit_are_told_before_the_design(tmp_path, monkeypatch, words, meaning):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(cli.circuit, "_designed", lambda *_: pytest.fail("designed all the same"))
    code, text = run(*QUICK, *words)
    assert code == 2
    assert meaning in text
    assert not [*tmp_path.iterdir()]


@needs_ngspice
@pytest.mark.parametrize("level", ["behavioural", "switched-capacitor"])
def test_a_budget_needs_an_emulation(level):
    code, text = run(*QUICK, "--level", level, "--budget", "2")
    if level == "behavioural":  # the emulation of ideal op amps is the network with its weights
        assert code == 0
        assert "what costs most" in text
    else:
        assert code == 2
        assert "emul" in text


@needs_ngspice
def test_an_unstable_circuit_is_told_in_a_sentence():
    code, text = run(*QUICK, "--margin", "2")
    assert code == 2
    assert "error: circuit: the pole model is unstable" in text
    assert "too slow at margin 2" in text


@pytest.mark.parametrize("option", ["--deck", "--bill", "--figure", "--json"])
def test_an_unwritable_folder_is_told_before_the_design(tmp_path, monkeypatch, option):
    monkeypatch.setattr(cli.circuit, "_designed", lambda *_: pytest.fail("designed all the same"))
    blocked = tmp_path / "file"
    blocked.write_text("kept")
    code, text = run(*QUICK, option, blocked / "result")
    assert code == 2
    assert "cannot be written" in text
    assert blocked.read_text() == "kept"


FAILURES = {
    "unstable": (["--margin", "2"], ""),
    "ngspice is killed": ([], "kill -9 $$"),
    "ngspice fails": ([], "echo no convergence; exit 1"),
    "no answer": ([], ": > out.raw"),
}


@needs_ngspice
@pytest.mark.parametrize(("words", "script"), FAILURES.values(), ids=FAILURES)
def test_a_circuit_that_fails_costs_no_earlier_result(tmp_path, monkeypatch, words, script):
    if script:
        program = tmp_path / "ngspice"
        program.write_text(f"#!/bin/sh\n{script}\n")
        program.chmod(0o755)
        monkeypatch.setenv("ANN_DC_NGSPICE", str(program))
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    files = {option: tmp_path / f"result.{option[2:]}" for option in ("--deck", "--bill", "--json")}
    for file in files.values():
        file.write_text("of the last run")
    code, text = run(*QUICK, *words, *(word for pair in files.items() for word in pair))
    assert code == 2
    assert text.startswith("error: ")
    assert [file.read_text() for file in files.values()] == 3 * ["of the last run"]


@needs_ngspice
@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no /dev/full")
def test_a_full_disk_costs_no_earlier_result(tmp_path):
    result = tmp_path / "result.json"
    result.write_text("of the last run")
    code, text = run(*QUICK, "--deck", "/dev/full", "--json", result)
    assert code == 2
    assert "No space left on device" in text
    assert result.read_text() == "of the last run"
    assert [*tmp_path.iterdir()] == [result]


@needs_ngspice
def test_a_ladder_of_two_rungs(tmp_path, monkeypatch):
    from ann_dc.fidelity import ladder, rung
    from ann_dc.hardware.parts.levels import BEHAVIOURAL, macro, switched_capacitor

    steps = (
        rung.Rung(name="ideal", level=BEHAVIOURAL),
        rung.Rung(name="op amps", level=macro()),
        rung.Rung(name="too slow", level=switched_capacitor(step=0.1), slow=True),
    )
    seeds = []
    monkeypatch.setattr(ladder, "rungs", lambda *_, seed: seeds.append(seed) or steps)
    figure, result = tmp_path / "ladder.png", tmp_path / "ladder.json"
    words = ["--level", "ladder", "--seed", "3", "--figure", figure, "--json", result]
    code, text = run(*QUICK, *words)
    assert code == 0
    assert seeds == [3]
    assert "too slow" not in text
    assert f"wrote {figure}" in text.replace("\n", "")
    assert figure.read_bytes().startswith(b"\x89PNG")
    rungs = {found["rung"]: found for found in strict(result)["rungs"]}
    names = [name.split(",")[0] for name in rungs]
    assert names[:4] == ["ODE", "recurrent layer", "ideal", "op amps"]
    assert all(name.endswith("on this CPU") for name in names[4:])
    circuit = rungs["op amps"]
    assert circuit["predicted_error"] == pytest.approx(circuit["error"], rel=0.05)
    assert circuit["power"] is None
    assert circuit["parts"]["op amps"] > 0


def test_netlist_bill_and_prediction_need_no_ngspice(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.delenv("ANN_DC_NGSPICE", raising=False)
    deck, bill, result = (tmp_path / name for name in ("a.cir", "a.csv", "a.json"))
    code, text = run(
        *CIRCUIT, "--no-simulate", "--deck", deck, "--bill", bill, "--json", result,
        "--samples", "2", "--budget", "1",
    )  # fmt: skip
    assert code == 0, text
    assert deck.read_text().endswith(".end\n")
    assert bill.read_text().startswith("cell,component,")
    meaning = json.loads(result.read_text())
    assert meaning["settled"] is None
    assert meaning["predicted"]["control_error"] < 1e-3
    code, text = run(*CIRCUIT, "--no-simulate", "--margin", "3")
    assert code == 1
    assert "oscillates" in text
    code, text = run(*CIRCUIT, "--no-simulate", "--figure", tmp_path / "a.png")
    assert code == 2
    assert "--figure" in text
