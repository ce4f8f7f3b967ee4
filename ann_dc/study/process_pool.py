"""Tasks are done apart: each thread has a process that can be ended without harm to the others.

A point that hangs cannot be ended within its process, whatever language it hangs in, and one that
takes its process along must not take others along. So a thread hands its task to a process of its
own, waits as long as the task may take, and then ends it or takes what it says.
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

from ann_dc.errors import StudyError
from ann_dc.study.main_script import own_script
from ann_dc.study.records import LOST, TIMED_OUT
from ann_dc.study.task_results import Attempt, Task, Work, circumstances
from ann_dc.study.worker import GRACE, serve

FIRST = 10.0
"""Seconds more for the first task of a process, which loads and compiles what it needs."""
START = 120.0
"""Seconds until a process has to be there."""
STARTS = 3
"""Of a process that is killed before it has begun."""
_STARTING = threading.Lock()


def pickled(work: Work) -> bytes:
    """Work as bytes for other processes.

    Parameters
    ----------
    work : callable

    Raises
    ------
    StudyError
        If it cannot be one of theirs.
    """
    try:
        return pickle.dumps(work)
    except Exception as error:
        try:
            import cloudpickle  # comes with Dask; takes functions that have no name
        except ImportError:
            raise StudyError(
                f"what is to be done cannot be sent to other processes ({error}); write its "
                "functions into a module, not into another function"
            ) from error
        return cloudpickle.dumps(work)


MOMENT = 0.01
"""Seconds between two looks at a process that is ending."""


class Worker:
    """A process that does tasks, as who waits for it sees it.

    Parameters
    ----------
    work : bytes
        A pickled `Work`.

    Raises
    ------
    StudyError
        If it does not get as far as its first task.
    """

    def __init__(self, work: bytes) -> None:
        for starts_left in reversed(range(STARTS)):
            self._start(work)
            problem = self._first_word()
            if not problem:
                return
            was_killed = (self._process.exitcode or 0) < 0
            self.end()
            if not (was_killed and starts_left):
                raise StudyError(f"no process can do the work: {problem}")

    def _start(self, work: bytes) -> None:
        context = multiprocessing.get_context("spawn")
        self._connection, there = context.Pipe()
        self._process = context.Process(target=serve, args=(there, work, own_script()), daemon=True)
        _start(self._process)
        there.close()
        self._is_new = True

    def _first_word(self) -> str:
        """Why it cannot do the work; nothing if it can."""
        try:
            if self._connection.poll(START):
                return self._connection.recv()
            return f"one was not there after {START:g} s"
        except (EOFError, OSError):
            return f"one {self._ending()} before it began"

    def _ending(self) -> str:
        """How it ended, which another thread may be the first to hear."""
        self._process.join()
        until = time.monotonic() + GRACE
        while self._process.exitcode is None and time.monotonic() < until:
            time.sleep(MOMENT)
        return _end(self._process.exitcode)

    @property
    def is_there(self) -> bool:
        """Whether it can take a task."""
        return self._process.is_alive() and not self._connection.poll()

    def attempted(self, task: Task, seconds: float | None) -> Attempt:
        """Have a task done; afterwards the process may be gone.

        Parameters
        ----------
        task : Task
        seconds : float or None
            After which it is ended; never if None.
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
        """End it, and what it has started; nothing if it has ended."""
        self._process.terminate()
        self._process.join(GRACE)
        self._process.kill()
        self._process.join()


def _start(process: SpawnProcess) -> None:
    """Start it also where processes may have none, as Dask's: it ends with them by itself.

    Ctrl-C is not for it, from its first moment on.
    """
    config = multiprocessing.current_process()._config  # type: ignore[attr-defined]
    with _STARTING:
        is_daemon = config.pop("daemon", None)
        try:
            with _interrupts_blocked(), _script_omitted():
                process.start()
        finally:
            if is_daemon is not None:
                config["daemon"] = is_daemon


@contextlib.contextmanager
def _script_omitted() -> Iterator[None]:
    """Start processes that do not run the script of this one, which may run a study itself.

    `multiprocessing` takes no notice of a module of this name.
    """
    main = sys.modules["__main__"]
    before, main.__spec__ = main.__spec__, ModuleSpec("__main__", None)
    try:
        yield
    finally:
        main.__spec__ = before


@contextlib.contextmanager
def _interrupts_blocked() -> Iterator[None]:
    """Let a process inherit that it takes no interrupts, where the system has such a mask."""
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    resource_tracker.ensure_running()  # whose start lets interrupts through again
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _end(code: int | None) -> str:
    """How a process ended, by its exit code."""
    if code is None or code >= 0:
        return f"ended with exit code {code}"
    return f"was ended by signal {-code} ({signal.strsignal(-code)})"


class Apart:
    """Has tasks done by processes, one for each thread that calls it.

    Parameters
    ----------
    work : bytes
        A pickled `Work`.
    """

    def __init__(self, work: bytes) -> None:
        self._work = work
        self._own = threading.local()
        self._every: list[Worker] = []
        self._lock, self._closed = threading.Lock(), False

    def __call__(self, task: Task, seconds: float | None) -> Attempt:
        """What becomes of a task.

        Parameters
        ----------
        task : Task
        seconds : float or None
            That it may take; None for no limit.

        Raises
        ------
        StudyError
            If no process can do the work.
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
        """End all processes; tasks that they were doing are lost."""
        with self._lock:
            self._closed = True
            for worker in self._every:
                worker.end()


@functools.lru_cache(maxsize=4)
def _apart(work: bytes) -> Apart:
    return Apart(work)


def attempted_apart(work: bytes, task: Task, seconds: float) -> Attempt:
    """Have a task done by a process of this thread's own, in a worker of somebody else's.

    Parameters
    ----------
    work : bytes
        A pickled `Work`.
    task : Task
    seconds : float
        That it may take.
    """
    return _apart(work)(task, seconds)
