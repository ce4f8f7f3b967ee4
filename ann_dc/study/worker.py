"""Worker process that executes tasks one by one until its parent ends."""

from __future__ import annotations

import ctypes
import multiprocessing
import os
import signal
import sys
import threading
import time
from multiprocessing.connection import Connection, wait
from types import FrameType

from ann_dc.study.main_script import Script, loaded
from ann_dc.study.task_results import attempted

IDLE = 60.0
"""Seconds without a task after which a worker exits. A new worker is started if tasks follow."""
PARENT_DEATH_SIGNAL = 1
"""Option number of the Linux call `prctl`."""
GRACE = 0.5
"""Seconds in which a terminating worker may terminate its child processes."""
THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")


def serve(connection: Connection, work: bytes, script: Script) -> None:
    """Receive tasks from a connection and send the attempts.

    The first message is the reason why the work (a pickled `Work`) cannot be executed, or empty.
    The script of the parent is run if the work needs its functions.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # who started it decides
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

    with threadpoolctl.threadpool_limits(1):
        connection.send("")
        while connection.poll(IDLE):
            try:
                task = connection.recv()
            except EOFError:
                return
            connection.send(attempted(do, task))


def _end(number: int, frame: FrameType | None) -> None:
    """Raise `KeyboardInterrupt`, so that every ``finally`` terminates child processes."""
    raise KeyboardInterrupt


def _tie_to_parent() -> None:
    """Exit when the parent ends, even in the middle of a task that hangs."""
    threading.Thread(target=_leave_with_parent, daemon=True).start()
    if sys.platform == "linux":  # a thread of Python's cannot run where another keeps its lock
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
