"""Machines that lack parts of Linux: the package imports and runs without them."""

import ast
import os
import subprocess
import sys
from pathlib import Path

import pytest
from each_file import of_every_file
from ngspice_runs import ENDLESS, on_linux, wait_for, working_in
from simulator import needs_ngspice

import ann_dc
from ann_dc.backends.spice.ngspice.runner import Ngspice
from ann_dc.errors import SpiceTimeoutError
from ann_dc.resources import cores

MODULES = sorted(Path(ann_dc.__file__).parent.rglob("*.py"))
POSIX = {"fcntl", "grp", "posix", "pwd", "resource", "syslog", "termios", "tty"}
"""Modules that Windows does not have."""

PRELUDE = """
import builtins, os, signal, sys
import numba, scipy.linalg  # for the machine that there is
sys.platform = "neither"  # nothing that asks for Linux
def imported(name, *given, real=builtins.__import__, **more):
    importer = str((given[0] if given else None or {}).get("__name__"))
    if importer.startswith("ann_dc") and name in MISSING:
        raise ImportError(name)
    return real(name, *given, **more)
builtins.__import__ = imported
"""
"""Python's own modules keep what they import."""

LACKS = (
    f"MISSING = {POSIX}; "
    + """
del os.sched_getaffinity, os.killpg, signal.pthread_sigmask
"""
)
"""The first is missing on macOS too, all of them on Windows."""

WORK = """
import ann_dc
folder = sys.argv[1]
study = ann_dc.Study(
    subject="double_integrator", vary={"nonideal.mismatch": [0.003]}, samples=2,
    metrics=["settling_time"])
print(study.run(folder + "/study", workers=1).outcomes)
network = study.subject.wired
ann_dc.export_network(network, "weights", folder + "/out")
batch = ann_dc.OdeBackend().run_batch(network, {"q_d.x": [1.0, 2.0]})
print([outcome.name for outcome in batch.outcomes])
"""


@pytest.mark.sampled(10)
@of_every_file(MODULES)
def test_module_does_not_import_posix_modules_when_loaded(path):
    tree = ast.parse(path.read_text(encoding="utf-8"))
    loaded = [node for node in tree.body if isinstance(node, (ast.Import, ast.ImportFrom))]
    names = {alias.name for node in loaded for alias in node.names}
    assert not POSIX & (names | {getattr(node, "module", None) for node in loaded})


@pytest.mark.slow
def test_work_is_done_without_what_linux_alone_has(tmp_path):
    done = subprocess.run(
        [sys.executable, "-c", PRELUDE + LACKS + WORK, tmp_path],
        capture_output=True, text=True, timeout=120, encoding="utf-8",
        env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout == "{'settled': 2}\n['SETTLED', 'SETTLED']\n"


@needs_ngspice
@on_linux
def test_ngspice_is_ended_where_there_are_no_groups_of_processes(tmp_path, monkeypatch):
    monkeypatch.delattr(os, "killpg")
    monkeypatch.setattr(sys, "platform", "neither")
    with pytest.raises(SpiceTimeoutError):
        Ngspice(timeout=0.5, keep=tmp_path).run(ENDLESS)
    wait_for(lambda: not working_in(tmp_path))


@pytest.mark.parametrize("affinity", [True, False])
def test_cores_are_counted_with_and_without_an_affinity(monkeypatch, affinity):
    monkeypatch.setattr(os, "sched_getaffinity", lambda process: {2, 5, 7}, raising=False)
    monkeypatch.setattr(os, "cpu_count", lambda: 8)
    if not affinity:
        monkeypatch.delattr(os, "sched_getaffinity")
    assert cores() == (3 if affinity else 8)
