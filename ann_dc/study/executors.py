"""Who does the tasks: processes of our own, or any executor."""

from __future__ import annotations

import functools
from abc import ABC, abstractmethod
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future, ThreadPoolExecutor
from typing import Any

from ann_dc.errors import StudyError
from ann_dc.resources import cores
from ann_dc.study.process_pool import Apart, attempted_apart, pickled
from ann_dc.study.records import LOST
from ann_dc.study.task_results import Attempt, Task, Work, attempted


class Crew(ABC):
    """Takes tasks and tells what became of them.

    Attributes
    ----------
    knows_who : bool
        Whether a lost worker is charged to the task that it was at, and to no other.
    """

    knows_who: bool

    @abstractmethod
    def slots(self) -> int:
        """How many tasks are done at a time, just now."""

    @abstractmethod
    def submit(self, task: Task, seconds: float | None) -> Future[Attempt]:
        """Have a task done, soon.

        Parameters
        ----------
        task : Task
        seconds : float or None
            That it may take; None for no limit.
        """

    @abstractmethod
    def attempt(self, future: Future[Attempt]) -> Attempt:
        """What became of a task that is done.

        Parameters
        ----------
        future : Future

        Raises
        ------
        StudyError
            If nothing more can be done with this crew.
        """

    @abstractmethod
    def close(self) -> None:
        """Stop what is still being done, where that is ours."""


class Processes(Crew):
    """Processes of our own on this machine; each can be ended without harm to the others.

    Parameters
    ----------
    work : callable
    workers : int, optional
        As many as this process may use processors by default.
    """

    knows_who = True

    def __init__(self, work: Work, workers: int | None = None) -> None:
        self._workers = workers or cores()
        self._threads = ThreadPoolExecutor(self._workers, thread_name_prefix="study")
        self._apart = Apart(pickled(work))

    def slots(self) -> int:
        """As many as there are processes."""
        return self._workers

    def submit(self, task: Task, seconds: float | None) -> Future[Attempt]:
        """Have a task done by the next process that is free."""
        return self._threads.submit(self._apart, task, seconds)

    def attempt(self, future: Future[Attempt]) -> Attempt:
        """What became of a task."""
        return future.result()

    def close(self) -> None:
        """End all processes."""
        self._threads.shutdown(wait=False, cancel_futures=True)
        self._apart.close()
        self._threads.shutdown(wait=True)


class Foreign(Crew):
    """An executor of somebody else's: threads, processes, a cluster.

    A task with a limit is done in a process beside the executor's worker, which can be ended.

    Parameters
    ----------
    work : callable
    executor : concurrent.futures.Executor
    workers : int, optional
        Of the executor; those that it tells of by default.
    """

    knows_who = False  # Dask charges all that were waiting for the worker

    def __init__(self, work: Work, executor: Executor, workers: int | None = None) -> None:
        self._work, self._executor, self._workers = work, executor, workers
        self._client: Any = getattr(executor, "_client", None)
        self._is_dask = hasattr(self._client, "nthreads")
        self._words = {"pure": False} if self._is_dask else {}  # else it remembers what was lost
        self._pickled = b""

    def slots(self) -> int:
        """As many as the executor has workers just now."""
        if self._workers is not None:
            return self._workers
        if self._is_dask:  # where workers come and go
            return max(1, sum(self._client.nthreads().values()))
        return getattr(self._executor, "_max_workers", None) or cores()

    def submit(self, task: Task, seconds: float | None) -> Future[Attempt]:
        """Hand a task on.

        Raises
        ------
        StudyError
            If the executor takes none.
        """
        try:
            submit = functools.partial(self._executor.submit, **self._words)
            if seconds is None:
                return submit(attempted, self._work, task)
            self._pickled = self._pickled or pickled(self._work)
            return submit(attempted_apart, self._pickled, task, seconds)
        except RuntimeError as error:  # a broken one, or one that is shut down
            raise _broken(error) from error

    def attempt(self, future: Future[Attempt]) -> Attempt:
        """What became of a task; whatever the executor itself says is a worker lost.

        Raises
        ------
        StudyError
            If the executor is broken, or no process can do the work.
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
        """Leave the executor to who made it."""


def _broken(error: Exception) -> StudyError:
    return StudyError(
        f"the executor takes no more tasks ({type(error).__name__}: {error}); what is finished is "
        "kept: run the study again with another one, or without"
    )
