"""The application: version, help, errors as sentences, and how fast it starts."""

import os
import signal
import subprocess
import sys
import time
from statistics import median

import pytest
from command_line import ROOT, SMALL, refused, run, terminal

import ann_dc

COMMANDS = ["solve", "design", "coordinate", "circuit", "levels", "show", "plants", "paper"]


def test_version_and_help_name_every_command():
    assert run("--version") == (0, f"ann-dc {ann_dc.__version__}")
    code, text = run("--help")
    assert code == 0
    assert all(command in text for command in COMMANDS)


@pytest.mark.parametrize("command", COMMANDS)
def test_help_of_a_command_has_an_example_and_units(command):
    code, text = run(command, "--help")
    assert code == 0
    assert f"ann-dc {command} " in text.split("Usage examples:", 1)[1]
    assert any(unit in text for unit in ("seconds", "units", "time constants"))


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("words", "completed"),
    [
        ("ann-dc l", ["levels"]),
        ("ann-dc s", ["solve", "study", "show"]),
        ("ann-dc circuit --error", ["--error-budget"]),
        ("ann-dc solve car --tr", ["--trajectory"]),
        ("ann-dc solve uni", ["unicycle", "unicycle_soft_obstacle"]),
        ("ann-dc plants orb", ["orbit_transfer"]),
        ("ann-dc circuit car --level opa", ["opa192_ad734", "opa828_ad734"]),
        ("ann-dc run a.npz --level o", ["ode", "ota-c", "opa192_ad734", "opa828_ad734"]),
        ("ann-dc export car --preconditioner mul", ["multilevel"]),
        ("ann-dc solve car --preconditioner diagonal,mul", ["diagonal,multilevel"]),
        ("ann-dc solve car --backend r", ["recurrent"]),
        ("ann-dc show car --form cor", ["corrected"]),
        ("ann-dc coordinate car --coordinator n", ["newton"]),
        ("ann-dc coordinate car --lower i", ["iterated"]),
        ("ann-dc navigate w.toml --planner w", ["waypoint"]),
        ("ann-dc circuit car --series E9", ["E96", "E96-pairs"]),
    ],
)
def test_completion_names_commands_options_and_words(words, completed):
    count = str(len(words.split()) - 1)
    asked = {"COMP_WORDS": words, "COMP_CWORD": count, "_ANN_DC_COMPLETE": "complete_bash"}
    code, out, _ = terminal(**asked)
    assert (code, out.decode().split()) == (0, completed)


SCRIPTS = {
    "bash": (".bash_completions/ann-dc.sh", "complete -o default -F _ann_dc_completion ann-dc"),
    "zsh": (".zfunc/_ann-dc", "#compdef ann-dc"),
    "fish": (".config/fish/completions/ann-dc.fish", "complete --command ann-dc"),
}
"""File below the home folder, and a part of its content, by shell."""
NO_DETECTION = {"_TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION": "1"}
"""Environment in which typer takes the shell's name instead of looking at the parent process."""


@pytest.mark.sampled(2)
@pytest.mark.parametrize("shell", SCRIPTS)
def test_completion_is_installed_and_shown_for_each_shell(shell, tmp_path):
    name, part = SCRIPTS[shell]
    code, out, _ = terminal("--install-completion", shell, HOME=str(tmp_path), **NO_DETECTION)
    assert code == 0
    assert str(tmp_path / name) in out.decode()
    assert part in (tmp_path / name).read_text(encoding="utf-8")
    code, out, _ = terminal("--show-completion", shell, HOME=str(tmp_path), **NO_DETECTION)
    assert code == 0
    assert part in out.decode()


def test_without_arguments_the_help_is_shown():
    code, text = run()
    assert code == 2
    assert "Start with: ann-dc plants" in text


BAD = {
    "no such command": (["slove"], "slove"),
}


@pytest.mark.parametrize(("words", "meaning"), BAD.values(), ids=BAD)
def test_bad_input_is_told_in_a_sentence_with_code_2(words, meaning):
    refused(words, meaning)


@pytest.mark.slow
def test_errors_go_to_stderr():
    code, out, err = terminal("solve", "cra")
    assert (code, out) == (2, b"")
    assert err.startswith(b"error: unknown plant 'cra'; did you mean car")
    assert err.count(b"\n") == 1


@pytest.mark.skipif(os.name == "nt", reason="needs POSIX signals")
@pytest.mark.usefixtures("interruptible")
def test_an_interrupt_ends_quietly_with_130():
    words = [sys.executable, "-c", INTERRUPTIBLE, "design", "car"]
    process = subprocess.Popen(words, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    assert process.stdout is not None
    assert process.stdout.readline() == b"running\n"
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=60)
    assert (process.returncode, out, err) == (130, b"", b"")


INTERRUPTIBLE = """
import time
from ann_dc import cli, solver
def forever(*_, **__):
    print("running", flush=True)
    time.sleep(60)
solver.design = forever
cli.main()
"""


def test_importing_the_command_line_is_fast_and_loads_no_solver():
    heavy = ("numpy", "scipy", "sympy", "numba", "matplotlib", "torch")
    probe = (
        f"import sys; from ann_dc.cli import main; print([m for m in {heavy} if m in sys.modules])"
    )
    loading, bare = started(probe), started("print([])")
    assert {out for _, out in loading} == {"[]"}
    assert median(took for took, _ in loading) < median(took for took, _ in bare) + 1


@pytest.mark.slow
def test_a_solve_loads_only_what_it_needs():
    others = [f"ann_dc.cli.commands.{command}" for command in COMMANDS if command != "solve"]
    unneeded = ["torch", "matplotlib", "pandas", "casadi", "scipy.integrate", "scipy.optimize"]
    unneeded += ["scipy.special", "scipy.stats", "numba.np.arraymath", *others]
    started(SOLVE, times=1)  # whatever had to be compiled has been
    ((_, reported),) = started(
        f"{SOLVE}; print([m for m in {unneeded} if m in sys.modules])", times=1
    )
    assert reported == "[]"


SOLVE = """
import sys
from ann_dc.cli.commands.app import app
app(["solve", "double_integrator", "-N", "5", "--quiet"], standalone_mode=False)
""".strip()


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


OUTCOMES = {
    "certified": (["solve", *SMALL], 0),
    "listed": (["plants"], 0),
    "stopped at a limit": (["solve", *SMALL, "--max-settling", "5"], 1),
    "out of time": (["solve", *SMALL, "--time-limit", "1e-9"], 1),
    "unreachable": (["solve", "double_integrator", "-N", "1", "--no-verify"], 1),
    "unknown plant": (["solve", "kar"], 2),
    "unknown option": (["solve", "car", "--colour"], 2),
    "unknown command": (["sovle"], 2),
    "unwritable output": (["solve", *SMALL, "--json", str(ROOT)], 2),
}


@pytest.mark.parametrize(("words", "code"), OUTCOMES.values(), ids=OUTCOMES)
def test_exit_code_is_that_of_the_table(words, code):
    assert run(*words)[0] == code


def test_help_has_the_exit_codes():
    code, text = run("--help")
    assert code == 0
    assert "Exit code: 0 the result is certified or complete, 1 the command ran" in text
