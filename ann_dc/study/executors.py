"""Task executors: local processes, this process, or any ``concurrent.futures`` executor."""

from __future__ import annotations

import functools
from abc import ABC, abstractmethod
from collections.abc import Callable
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future, ThreadPoolExecutor
from typing import Any

from ann_dc.errors import StudyError
from ann_dc.resources import cores
from ann_dc.study.processes import Apart, attempted_apart, pickled
from ann_dc.study.records import LOST
from ann_dc.study.tasks import Attempt, Task, Work, attempted


class Crew(ABC):
    """Interface that accepts tasks and returns attempts.

    Attributes
    ----------
    knows_who : bool
        True if a lost worker is attributed to its running task and to no other task.
    """

    knows_who: bool

    @abstractmethod
    def slots(self) -> int:
        """Return the number of tasks that currently run in parallel."""

    @abstractmethod
    def submit(self, task: Task, seconds: float | None) -> Future[Attempt]:
        """Submit a task with a time limit in seconds; None for no limit."""

    @abstractmethod
    def attempt(self, future: Future[Attempt]) -> Attempt:
        """Return the attempt of a completed future.

        Raises `StudyError` if the executor cannot continue.
        """

    @abstractmethod
    def close(self) -> None:
        """Stop the running tasks if the processes belong to the study."""


class Processes(Crew):
    """Local processes, each of which can be terminated without effect on the others.

    The default number of workers is the number of processors available to this process.
    """

    knows_who = True

    def __init__(self, work: Work, workers: int | None = None) -> None:
        self._workers = workers or cores()
        self._threads = ThreadPoolExecutor(self._workers, thread_name_prefix="study")
        self._apart = Apart(pickled(work))

    def slots(self) -> int:
        """Return the number of processes."""
        return self._workers

    def submit(self, task: Task, seconds: float | None) -> Future[Attempt]:
        """Submit a task to the next free process."""
        return self._threads.submit(self._apart, task, seconds)

    def attempt(self, future: Future[Attempt]) -> Attempt:
        """Return the attempt of a completed future."""
        return future.result()

    def close(self) -> None:
        """Terminate all processes."""
        self._threads.shutdown(wait=False, cancel_futures=True)
        self._apart.close()
        self._threads.shutdown(wait=True)


class Foreign(Crew):
    """Executor of the caller: threads, processes or a cluster.

    A task with a time limit runs in a separate process next to the executor's worker, which can be
    terminated. The default number of workers is the number that the executor reports.
    """

    knows_who = False  # Dask charges all that were waiting for the worker

    def __init__(self, work: Work, executor: Executor, workers: int | None = None) -> None:
        self._work, self._executor, self._workers = work, executor, workers
        self._client: Any = getattr(executor, "_client", None)
        self._is_dask = hasattr(self._client, "nthreads")
        self._words = {"pure": False} if self._is_dask else {}  # else it remembers what was lost
        self._pickled = b""

    def slots(self) -> int:
        """Return the current number of workers of the executor."""
        if self._workers is not None:
            return self._workers
        if self._is_dask:  # where workers come and go
            return max(1, sum(self._client.nthreads().values()))
        return getattr(self._executor, "_max_workers", None) or cores()

    def submit(self, task: Task, seconds: float | None) -> Future[Attempt]:
        """Submit a task; raise `StudyError` if the executor accepts none."""
        try:
            submit = functools.partial(self._executor.submit, **self._words)
            if seconds is None:
                return submit(attempted, self._work, task)
            self._pickled = self._pickled or pickled(self._work)
            return submit(attempted_apart, self._pickled, task, seconds)
        except RuntimeError as error:  # a broken one, or one that is shut down
            raise _broken(error) from error

    def attempt(self, future: Future[Attempt]) -> Attempt:
        """Return the attempt of a completed future.

        An error of the executor itself counts as a lost worker. Raises `StudyError` if the executor
        is broken or no process can execute the work.
        """
        try:
            return future.result()
        except StudyError:
            raise
        except BrokenExecutor as error:
            raise _broken(error) from error
        except (Exception, CancelledError) as error:
            return Attempt([], LOST, f"{type(error).__name__}: {error}", {})

    def close(self) -> None:
        """Do nothing; the caller closes the executor."""


class Here(Executor):
    """Serial executor: `submit` runs the call in this process before it returns.

    Examples
    --------
    >>> Here().submit(max, 3, 5).result()
    5
    """

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Call a function and return the completed future."""
        done: Future[Any] = Future()
        try:
            done.set_result(fn(*args, **kwargs))
        except Exception as error:
            done.set_exception(error)
        return done


def _broken(error: Exception) -> StudyError:
    return StudyError(
        f"the executor takes no more tasks ({type(error).__name__}: {error}); what is finished is "
        "kept: run the study again with another one, or without"
    )
