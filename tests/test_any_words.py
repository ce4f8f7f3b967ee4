"""Commands drawn at random, right and wrong: an answer or a sentence, never a traceback."""

import numpy as np
import pytest
from seeds import seeds
from typer.testing import CliRunner

from ann_dc.cli.commands.app import app

PROBLEMS = [
    *["double_integrator"] * 12,
    "car", "cra", "", "nowhere.toml", ".", "problem.toml", "broken.toml",
]  # fmt: skip
COMMON = {
    "-N": ["2", "3", "4", "0", "-1", "x", "1.5"],
    "--q-0": ["0,0", "0.1,0", "1", "a,b", "nan,0", "free,0", ""],
    "--q-d": ["1,0", "2,free", "0,0", "1,0,0", "inf,0", "free,free"],
    "--set": ["dt=0.2", "q_d=1,0", "scale.x=10", "scale.x=-1", "D=1", "dt=", "=", "dt=nan"],
    "--quiet": [None],
}
FILES = ["-", "out.json", "new/out.json", ".", "", "no\0name", "folder"]
RUNS = {
    "--backend": ["ode", "recurrent", "spice", ""],
    "--form": ["corrected", "printed", "S3", "S14", "S16", "S99"],
    "--initial-guess": ["line", "zero", "random", "nowhere"],
    "--seed": ["0", "7", "-1", "x"],
    "--preconditioner": ["multilevel", "resistive-grid,cyclic-reduction", "diagonal", "all", ""],
    "--max-settling": ["200", "50", "0", "-3", "nan"],
    "--max-steps": ["200", "0", "2.5"],
    "--table": ["short", "all", "none", "some"],
    "--overwrite": [None],
    "--time-limit": ["5", "0.01", "0", "-1", "x"],
    "--json": FILES,
    "--weights": ["net.npz", *FILES],
    "--save": ["net.npz", *FILES],
    "--method": ["RK45", "Radau", "Euler"],
    "--no-verify": [None],
    "--order": ["two-phase", "stage-by-stage", "any"],
    "--step": ["adaptive", "0.001", "-1", "x"],
    "--accelerate": [None],
}
DESIGN = {
    "--initial-guess": ["line", "zero", "nowhere"],
    "--preconditioner": ["multilevel", "resistive-grid,cyclic-reduction", "diagonal", "all", ""],
    "--diagnose": [None],
    "--output": ["designed", "folder", "no\0name"],
}
CIRCUIT = {
    "--level": ["behavioural", "macro", "ota-c", "opamp", ""],
    "--a0": ["1e5", "10", "0", "x"],
    "--gbw": ["1e7", "-1"],
    "--bandwidth-margin": ["10", "0", "nan"],
    "--full-scale": ["1", "0", "-2", "1e9"],
    "--series": ["exact", "E24", "E7"],
    "--preconditioner": ["diagonal", "multilevel", "mesh"],
    "--error-budget": ["3", "-1"],
    "--samples": ["2", "-1"],
    "--deck": FILES,
    "--bom": ["bill.csv", *FILES],
    "--json": FILES,
}
SHOW = {
    "--equations": [None],
    "--cell": [None],
    "--counts": [None],
    "--scales": [None],
    "--latex": [None],
    "--form": RUNS["--form"],
}
COMMANDS = {
    "solve": RUNS,
    "design": DESIGN,
    "circuit": CIRCUIT,
    "show": SHOW,
    "coordinate": {
        "--coordinator": ["two-gains", "newton", "x"],
        "--max-iterations": ["5", "0"],
        "--tolerance": ["1e-3", "-1", "x"],
        "--json": FILES,
    },
    "plants": {"--help": [None], "--what": ["?"]},
    "solvv": {},
}
LIKELY = ["solve", "design", "circuit", "show"]
TOML = """name = "two"
states = ["x", "v"]
controls = ["a"]
dt = 0.1
horizon = 3
cost = "a**2"
q_0 = [0, 0]
q_d = [1, 0]
[dynamics]
x = "v"
v = "a"
"""


def words_of(seed: int) -> list[str]:
    rng = np.random.default_rng(seed)
    draw = lambda items: items[rng.integers(len(items))]  # noqa: E731
    command = draw([*COMMANDS, *LIKELY, *LIKELY])
    words = [command]
    if command not in ("plants", "solvv"):
        words += [draw(PROBLEMS)]
        words += ["-N", "3"] if rng.random() < 0.8 else []
    if command == "circuit" and rng.random() < 0.8:
        words.append("--no-simulate")
    options = COMMANDS[command] | (COMMON if command in LIKELY else {})
    for _ in range(rng.integers(0, 4)):
        if options:
            option = draw(list(options))
            value = draw(options[option])
            words += [option] if value is None else [option, value]
    return words


def answered(seed: int, folder, monkeypatch) -> None:
    monkeypatch.chdir(folder)
    (folder / "problem.toml").write_text(TOML)
    (folder / "broken.toml").write_text("states = [")
    (folder / "folder").mkdir()
    words = words_of(seed)
    result = CliRunner().invoke(app, words, env={"COLUMNS": "80", "TERM": "dumb"})
    reported = f"{words}\n{result.output}\n{result.exception!r}"
    assert result.exception is None or isinstance(result.exception, SystemExit), reported
    assert result.exit_code in (0, 1, 2), reported
    assert "Traceback" not in result.output, reported
    if result.exit_code == 2:  # a sentence that says what to do
        assert "rror" in result.output, reported


@seeds(30)
@pytest.mark.sampled
def test_a_few_random_commands(seed, tmp_path, monkeypatch):
    answered(seed, tmp_path, monkeypatch)


@pytest.mark.slow
@seeds(270, first=30)
def test_many_random_commands(seed, tmp_path, monkeypatch):
    answered(seed, tmp_path, monkeypatch)
