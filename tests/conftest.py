"""Settings of all tests."""

import gc
import os
import signal
from random import Random

import pytest
from seeds import load_profile, mark_properties

from ann_dc.jit_cache import FOLDER_VARIABLE

load_profile()

collect_ignore = ["added_function.py"]
"""A script that `tests/network/test_functions_added.py` runs in a changed copy of the package."""


CASES = 6
"""So many of a sampled test's cases CI runs, or as many as its mark says: those that have most
values that no other has."""


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items):
    """Of a long table that takes seconds CI runs a few cases, always the same ones.

    `make slow` runs the others.
    """
    mark_properties(items)
    tables = {}
    for item in items:
        if item.get_closest_marker("sampled") and not item.get_closest_marker("slow"):
            tables.setdefault(item.nodeid.partition("[")[0], []).append(item)
    for test, cases in tables.items():
        left = Random(test).sample(cases, len(cases))
        (most,) = cases[0].get_closest_marker("sampled").args or (CASES,)
        seen, chosen = set(), 0
        while left and chosen < most:
            best = max(left, key=lambda item: len(item.callspec.indices.items() - seen))
            seen |= best.callspec.indices.items()
            left.remove(best)
            chosen += 1
        for item in left:
            item.add_marker(pytest.mark.slow)


def pytest_collection_finish():
    """What was imported stays: the garbage collector need not look at it again and again."""
    gc.collect()
    gc.freeze()


@pytest.fixture(scope="session", autouse=True)
def code_of_their_own(tmp_path_factory):
    """A folder for compiled code that all processes of a test run share, and nobody else."""
    temporary = tmp_path_factory.getbasetemp()
    shared = temporary.parent if "PYTEST_XDIST_WORKER" in os.environ else temporary
    before = os.environ.get(FOLDER_VARIABLE)
    os.environ[FOLDER_VARIABLE] = str(shared / "compiled")
    yield
    if before is not None:
        os.environ[FOLDER_VARIABLE] = before


@pytest.fixture
def interruptible():
    """Python's own answer to SIGINT, here and in child processes.

    A run that was started with ``nohup``, or by ``&`` in a script, ignores SIGINT, and so does
    whatever it starts.
    """
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.fixture
def endless_ngspice(tmp_path, monkeypatch):
    """A program that never ends, in ngspice's place."""
    program = tmp_path / "ngspice"
    program.write_text("#!/bin/sh\nexec sleep 600\n")
    program.chmod(0o755)
    monkeypatch.setenv("ANN_DC_NGSPICE", str(program))
