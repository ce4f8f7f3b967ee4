"""Execution of tasks in separate processes that can be terminated individually.

A case that hangs cannot be terminated from inside its process. A case that crashes its process must
not affect other cases. Each thread therefore sends its task to a dedicated process and waits for
the time limit of the task. It then receives the result or terminates the process.
"""

from __future__ import annotations

import contextlib
import functools
import multiprocessing
import pickle
import signal
import sys
import threading
import time
from collections.abc import Iterator
from importlib.machinery import ModuleSpec
from multiprocessing import resource_tracker
from multiprocessing.context import SpawnProcess
from typing import Any

from ann_dc.errors import StudyError
from ann_dc.study.records import LOST, TIMED_OUT
from ann_dc.study.tasks import Attempt, Task, Work, circumstances
from ann_dc.study.worker import GRACE, own_script, serve

FIRST = 10.0
"""Additional seconds for the first task of a process, which loads and compiles code."""
START = 120.0
"""Time limit for the start of a process, in seconds."""
STARTS = 3
"""Number of start attempts for a process that is killed before its first task."""
MOMENT = 0.01
"""Seconds between two checks of a process that is terminating."""
_STARTING = threading.Lock()


def pickled(work: Work) -> bytes:
    """Serialise work for other processes.

    Raises `StudyError` if the work cannot be serialised.
    """
    try:
        return pickle.dumps(work)
    except Exception as error:
        try:
            import cloudpickle  # comes with Dask; takes functions that have no name
        except ImportError:
            raise StudyError(
                f"the task cannot be sent to other processes ({error}); define its functions in "
                "a module, not in another function"
            ) from error
        return cloudpickle.dumps(work)


class Worker:
    """Handle of a process that executes tasks (a pickled `Work`).

    The constructor raises `StudyError` if the process does not become ready for its first task.
    """

    def __init__(self, work: bytes) -> None:
        for starts_left in reversed(range(STARTS)):
            problem = self._start(work)
            if not problem:
                return
            was_killed = (self._process.exitcode or 0) < 0
            self.end()
            if not (was_killed and starts_left):
                raise StudyError(f"no process can run the tasks: {problem}")

    def _start(self, work: bytes) -> str:
        """Start the process and return the reason why it cannot execute the work, or nothing."""
        context = multiprocessing.get_context("spawn")
        self._connection, there = context.Pipe()
        self._process = context.Process(target=serve, args=(there, work, own_script()), daemon=True)
        _start(self._process)
        there.close()
        self._is_new = True
        try:
            if self._connection.poll(START):
                return self._connection.recv()
            return f"a process did not start within {START:g} s"
        except (EOFError, OSError):
            return f"a process {self._ending()} before it started"

    def _ending(self) -> str:
        """Wait for the process to end and return the description of its end.

        Another thread may reap the process first.
        """
        self._process.join()
        until = time.monotonic() + GRACE
        while self._process.exitcode is None and time.monotonic() < until:
            time.sleep(MOMENT)
        code = self._process.exitcode
        if code is None or code >= 0:
            return f"ended with exit code {code}"
        return f"was ended by signal {-code} ({signal.strsignal(-code)})"

    @property
    def is_there(self) -> bool:
        """True if the process can accept a task."""
        return self._process.is_alive() and not self._connection.poll()

    def attempted(self, task: Task, seconds: float | None) -> Attempt:
        """Execute a task, and terminate the process after `seconds` (None for no limit).

        The process may have ended afterwards.
        """
        began = time.monotonic()
        longest = None if seconds is None else seconds + FIRST * self._is_new
        self._is_new = False
        try:
            self._connection.send(task)
            if self._connection.poll(longest):
                attempt: Attempt = self._connection.recv()
                if attempt.outcome == LOST:  # out of memory
                    self.end()
                return attempt
            outcome, message = TIMED_OUT, ""
            self.end()
        except (EOFError, OSError):
            outcome, message = LOST, f"its process {self._ending()}"
        each = (time.monotonic() - began) / max(1, len(task.points))
        return Attempt([], outcome, message, circumstances(self._process.pid, each))

    def end(self) -> None:
        """Terminate the process and its child processes; do nothing if it has ended."""
        self._process.terminate()
        self._process.join(GRACE)
        self._process.kill()
        self._process.join()


def _start(process: SpawnProcess) -> None:
    """Start a process, also from daemonic processes (Dask), with which it ends.

    The process does not run the parent script, because `multiprocessing` ignores a module of the
    name ``__main__``. Ctrl-C is blocked for the new process from its start.
    """
    config = multiprocessing.current_process()._config  # type: ignore[attr-defined]
    unnamed = ModuleSpec("__main__", None)
    with (
        _STARTING,
        _replaced(config, "daemon", False),
        _replaced(vars(sys.modules["__main__"]), "__spec__", unnamed),
        _interrupts_blocked(),
    ):
        process.start()


@contextlib.contextmanager
def _replaced(values: dict[str, Any], key: str, value: Any) -> Iterator[None]:
    """Replace a value in a dictionary for the time of the ``with`` block."""
    before = values.get(key, value)
    values[key] = value
    try:
        yield
    finally:
        values[key] = before


@contextlib.contextmanager
def _interrupts_blocked() -> Iterator[None]:
    """Block interrupts for a new process if the system supports signal masks."""
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    resource_tracker.ensure_running()  # whose start lets interrupts through again
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


class Apart:
    """Callable that executes tasks (pickled `Work`) in one process per calling thread."""

    def __init__(self, work: bytes) -> None:
        self._work = work
        self._own = threading.local()
        self._every: list[Worker] = []
        self._lock, self._closed = threading.Lock(), False

    def __call__(self, task: Task, seconds: float | None) -> Attempt:
        """Execute a task within `seconds` (None for no limit) and return the attempt.

        Raises `StudyError` if no process can execute the work.
        """
        worker: Worker | None = getattr(self._own, "worker", None)
        if worker is None or not worker.is_there:
            worker = self._own.worker = self._new(worker)
        return worker.attempted(task, seconds)

    def _new(self, old: Worker | None) -> Worker:
        if old is not None:
            old.end()
        worker = Worker(self._work)
        with self._lock:
            self._every = [one for one in self._every if one is not old] + [worker]
            if self._closed:
                worker.end()
        return worker

    def close(self) -> None:
        """Terminate all processes; their running tasks are lost."""
        with self._lock:
            self._closed = True
            for worker in self._every:
                worker.end()


@functools.lru_cache(maxsize=4)
def _apart(work: bytes) -> Apart:
    return Apart(work)


def attempted_apart(work: bytes, task: Task, seconds: float) -> Attempt:
    """Execute a task in a process of this thread, inside a worker of an executor.

    The process is terminated after `seconds`.
    """
    return _apart(work)(task, seconds)
