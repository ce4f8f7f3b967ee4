"""The command line in tests: a command in this process or in one of its own, and its files."""

import json
import os
import subprocess
import sys
from pathlib import Path

from typer.testing import CliRunner

from ann_dc.cli.commands.app import app

ROOT = Path(__file__).parents[1]
PENDULUM = ROOT / "demos" / "pendulum.toml"
SMALL = ["double_integrator", "-N", "5", "--no-verify"]
RECURRENT = ["double_integrator", "-N", "5", "--backend", "recurrent"]
COORDINATE = ["coordinate", "double_integrator", "-N", "5"]
CIRCUIT = ["circuit", "double_integrator", "-N", "5"]
QUICK = ["circuit", "double_integrator", "-N", "4"]


def run(*words):
    """Exit code and everything printed, without rules, runs of blanks as one."""
    plain = {"COLUMNS": "80", "NO_COLOR": "1", "TERM": "dumb"}
    result = CliRunner().invoke(app, [str(word) for word in words], env=plain)
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


def refused(words, meaning):
    """Bad input is told in a sentence, with code 2."""
    code, text = run(*words)
    assert code == 2
    assert meaning in text
    assert "Traceback" not in text


def printed_json(*words):
    """Return exit code and data of a command whose only output is JSON."""
    code, text = run(*words, "--json", "-")
    return code, json.loads(text)
