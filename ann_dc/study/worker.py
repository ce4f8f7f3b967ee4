"""Worker process that executes tasks one by one until its parent ends.

A worker of `multiprocessing` runs the script of its parent again. A script without ``if __name__ ==
"__main__":`` would then run its study in every worker. A worker of a study runs the script only if
the work needs a function of the script. It then stops where the study begins.
"""

from __future__ import annotations

import contextlib
import ctypes
import multiprocessing
import os
import pickle
import signal
import sys
import threading
import time
from multiprocessing.connection import Connection, wait
from pathlib import Path
from types import FrameType, ModuleType
from typing import Any, NamedTuple

from ann_dc.errors import StudyError
from ann_dc.study.tasks import attempted

IDLE = 60.0
"""Seconds without a task after which a worker exits. A new worker is started if tasks follow."""
PARENT_DEATH_SIGNAL = 1
"""Option number of the Linux call `prctl`."""
GRACE = 0.5
"""Seconds in which a terminating worker may terminate its child processes."""
THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
SCRIPT = "__mp_main__"
"""Name of the script module in a worker, as assigned by `multiprocessing`."""


class Script(NamedTuple):
    """Path of a script (empty for a notebook or a prompt), and the package of its imports."""

    file: str
    package: str | None


class _Reached(BaseException):
    """Raised in a worker where its script begins a study, after all functions above."""


_running: list[Script] = []


def serve(connection: Connection, work: bytes, script: Script) -> None:
    """Receive tasks from a connection and send the attempts.

    The first message is the reason why the work (a pickled `Work`) cannot be executed, or empty.
    The script of the parent is run if the work needs its functions.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent decides
    signal.signal(signal.SIGTERM, _end)
    _tie_to_parent()
    _be_quiet()
    os.environ |= dict.fromkeys(THREADS, "1")
    try:
        do = loaded(work, script)
    except Exception as error:
        connection.send(f"{type(error).__name__}: {error}")
        return
    import threadpoolctl  # after what the work needs: it limits what is loaded

    with threadpoolctl.threadpool_limits(1), contextlib.suppress(EOFError):
        connection.send("")
        while connection.poll(IDLE):
            connection.send(attempted(do, connection.recv()))


def _end(number: int, frame: FrameType | None) -> None:
    """Raise `KeyboardInterrupt`, so that every ``finally`` terminates child processes."""
    raise KeyboardInterrupt


def _tie_to_parent() -> None:
    """Exit when the parent ends, even in the middle of a task that hangs."""
    threading.Thread(target=_leave_with_parent, daemon=True).start()
    if sys.platform == "linux":  # a Python thread cannot run while another holds the interpreter
        ctypes.CDLL(None).prctl(PARENT_DEATH_SIGNAL, signal.SIGKILL)


def _leave_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        wait([parent.sentinel])
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(GRACE)
        os._exit(1)


def _be_quiet() -> None:
    nowhere = os.open(os.devnull, os.O_WRONLY)
    for stream in (1, 2):
        os.dup2(nowhere, stream)
    os.close(nowhere)


def own_script() -> Script:
    """Return the script of this process.

    >>> own_script() == own_script()
    True
    """
    main = sys.modules["__main__"]
    path = Path(getattr(main, "__file__", None) or "")
    file = str(path.absolute()) if path.is_file() else ""
    return Script(file, getattr(main, "__package__", None))


def loaded(pickled: bytes, given: Script) -> Any:
    """Return the unpickled object; run the script if a function of it is missing.

    Raises `StudyError` if a function is missing and no file defines it.

    >>> loaded(pickle.dumps(max), Script("", None))(3, 5)
    5
    """
    try:
        return pickle.loads(pickled)
    except AttributeError as error:
        if not given.file:
            raise StudyError(f"{error}; define its functions in a module") from error
    module = ModuleType(SCRIPT)
    module.__file__, module.__package__ = given
    sys.modules["__main__"] = sys.modules[SCRIPT] = module
    _running.append(given)
    with contextlib.suppress(_Reached):
        exec(compile(Path(given.file).read_bytes(), given.file, "exec"), vars(module))
    _running.clear()
    return pickle.loads(pickled)


def stop_script() -> None:
    """Stop the script that a worker runs; do nothing in any other process."""
    if _running:
        raise _Reached
