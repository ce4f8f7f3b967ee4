"""Work for tests of studies: what a point does is its setting, and its row depends on it alone."""

import ctypes
import os
import signal
import time
from pathlib import Path

import numpy as np

from ann_dc.study.records import HEAD, TAIL, Finished, Point
from ann_dc.study.stored_trajectories import packed
from ann_dc.study.tasks import Task

COLUMNS = (*HEAD, "does", "rho", "peak", *TAIL)
NATIVE = 3600.0
"""Seconds of a sleep that no signal handler of Python's ends."""


def points(*doings):
    """Points that do this and that, from number zero on."""
    return [
        Point(number, {"does": does, "rho": 0.5 + number}, 1000 + number)
        for number, does in enumerate(doings)
    ]


def tasks(points, size=1):
    """Tasks of so many points."""
    return [Task(tuple(points[i : i + size])) for i in range(0, len(points), size)]


def is_first(path):
    """Whether nobody was here before."""
    try:
        Path(path).touch(exist_ok=False)
    except FileExistsError:
        return False
    return True


def kill():
    os.kill(os.getpid(), signal.SIGKILL)


def out_of_memory():
    raise MemoryError


def spin():
    while True:
        pass


def sleep_natively():
    libc = ctypes.PyDLL(None)  # which keeps Python's lock
    while True:
        libc.sleep(int(NATIVE))


DOINGS = {
    "raise": lambda: 1 / 0,
    "kill": kill,
    "exit": lambda: os._exit(3),
    "vanish": lambda: os._exit(0),
    "leave": lambda: exit("enough"),
    "memory": out_of_memory,
    "spin": spin,
    "native": sleep_natively,
    "slow": lambda: time.sleep(0.05),
    "second": lambda: time.sleep(1.0),
}


def work(task):
    """A row for each point; ``once:PATH`` kills its process the first time.

    ``hang:PATH`` writes the process down and hangs.
    """
    return [done(point) for point in task.points]


def done(point):
    does = point.setting["does"]
    if does.startswith("once:") and is_first(does.removeprefix("once:")):
        kill()
    if does.startswith("hang:"):
        Path(does.removeprefix("hang:")).write_text(str(os.getpid()))
        sleep_natively()
    DOINGS.get(does, lambda: None)()
    drawn = np.random.default_rng(point.seed).standard_normal(3)
    row = {
        "point": point.number, "seed": point.seed, **point.setting, "peak": float(drawn.max()),
        "outcome": "settled", "message": "it settled", "versions": "1",
    }  # fmt: skip
    return Finished(row, packed({"drawn": drawn}))


def nonsense(task):
    """Rows of a point that nobody asked for."""
    return [done(points("good")[0]) for _ in task.points[1:]]


def odd(task):
    """A cell that no table can hold."""
    return [Finished(done(point).row | {"peak": [1.0]}) for point in task.points]
