"""Notices of compilations that take long."""

import os
import subprocess
import sys
import textwrap

import pytest

from ann_dc.jit_cache import FOLDER_VARIABLE

NOTICE = "ann_dc: compiling the solver (about 10 s, cached in "

PROGRAM = textwrap.dedent(
    """
    import logging, sys
    from ann_dc.jit_functions import kept

    @kept(seconds=float(sys.argv[1]))
    def first(x):
        return x + 1

    @kept(seconds=float(sys.argv[1]))
    def second(x):
        return x + 2

    if "quiet" in sys.argv:
        logging.getLogger("ann_dc").setLevel("ERROR")
    print(first(1), second(1))
    """
)


def run(folder, *words):
    """Return stdout and stderr of a process whose compile caches are in a folder."""
    done = subprocess.run(
        [sys.executable, *map(str, words)],
        env=os.environ | {"NUMBA_CACHE_DIR": f"{folder}/numba", FOLDER_VARIABLE: f"{folder}/cells"},
        capture_output=True,
        timeout=300,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout, done.stderr


def test_long_compilation_is_announced_once_per_process_and_never_if_cached(tmp_path):
    program = tmp_path / "program.py"
    program.write_text(PROGRAM)
    out, err = run(tmp_path, program, 3.0)
    assert out == "2 3\n"
    assert err.startswith(NOTICE + str(tmp_path))
    assert err.count("\n") == 1
    assert run(tmp_path, program, 3.0) == (out, "")


@pytest.mark.sampled(1)
@pytest.mark.parametrize("words", [(1.0,), (3.0, "quiet")], ids=["short", "silenced"])
def test_short_or_silenced_compilation_is_not_announced(tmp_path, words):
    program = tmp_path / "program.py"
    program.write_text(PROGRAM)
    assert run(tmp_path, program, *words) == ("2 3\n", "")


@pytest.mark.slow
@pytest.mark.parametrize("backend", ["ode", "recurrent"])
def test_first_solve_is_announced_and_second_is_not(tmp_path, backend):
    solve = "-m", "ann_dc", "solve", "double_integrator", "-N", "5", "--backend", backend
    out, err = run(tmp_path, *solve, "--json", "-")
    assert out.startswith("{")
    assert err.startswith(NOTICE)
    assert err.count(NOTICE) == 1
    assert NOTICE not in run(tmp_path, *solve)[1]
    assert run(tmp_path / "other", *solve, "--quiet") == ("", "")
