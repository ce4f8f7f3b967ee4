"""Execution of a study: submission of all tasks and storage of their records."""

from __future__ import annotations

import time
from collections import Counter, deque
from collections.abc import Iterable
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from typing import NamedTuple

from ann_dc.errors import StudyError, require_positive
from ann_dc.progress import Deadline, Paced, Progress, Stopped, silent
from ann_dc.study.executors import Crew, Foreign, Processes
from ann_dc.study.records import OUTCOME, Finished, Row
from ann_dc.study.scheduling import Job, verdict
from ann_dc.study.store import Store
from ann_dc.study.task_results import Attempt, Task, Work

SLACK = 1.0
"""Seconds that a task may take in addition to the limits of its cases."""
TURN = 0.2
"""Interval of progress reports and interrupt checks while no task ends, in seconds."""


class Tally(NamedTuple):
    """Summary of an execution.

    Attributes
    ----------
    outcomes : Counter of str
        Number of records by outcome.
    seconds : float
        Wall-clock time in seconds.
    stopped : str
        Reason of an early end; empty if the last case was run.
    """

    outcomes: Counter[str]
    seconds: float
    stopped: str


def execute(
    tasks: Iterable[Task],
    work: Work,
    store: Store,
    *,
    executor: Executor | None = None,
    workers: int | None = None,
    limit: float | None = None,
    common: Row | None = None,
    progress: Progress = silent,
) -> Tally:
    """Execute all tasks and store a record per case as soon as it is complete.

    The records do not depend on the executor or on the order. A task is split if it raises, exceeds
    its time limit or loses its worker twice. The splitting isolates the failing case, whose record
    has the outcome ``failed``, ``timed out`` or ``worker lost`` and the reason. The other cases are
    completed. A lost worker is replaced.

    Parameters
    ----------
    tasks : iterable of Task
        Tasks whose cases have no record.
    work : callable
        Function that returns a `Finished` for each case of a task. It is sent to other processes.
    store : Store
        Store with the columns `HEAD`, those of settings and metrics, and `TAIL`.
    executor : concurrent.futures.Executor, optional
        By default local processes. For Dask use ``client.get_executor()``.
    workers : int, optional
        Number of tasks in parallel.
    limit : float, optional
        Seconds per case. A task that exceeds its limit is terminated with its process, whatever
        blocks it.
    common : Row, optional
        Cells of every record, such as the versions.
    progress : Progress
        Receives the number of completed cases, the rate, the remaining time and the outcomes. It
        ends the execution by raising `Stopped`; Ctrl-C has the same effect. Records stored until
        then remain.

    Raises
    ------
    StoreError
        If records cannot be stored, for example on a full disk. Earlier records remain.
    StudyError
        If the executor is broken, or the work cannot be sent or started there.
    """
    if workers is not None:
        require_positive(StudyError, workers=workers)
    if limit is not None:
        require_positive(StudyError, limit=limit)
    crew = Processes(work, workers) if executor is None else Foreign(work, executor, workers)
    run = _Run(tasks, crew, store, limit, common or {})
    stopped = ""
    try:
        with Deadline(progress) as told:
            run.until_done(told)
    except Stopped as reason:
        stopped = str(reason)
        run.keep_finished()
    finally:
        for future in run.flying:
            future.cancel()
        crew.close()
    return Tally(run.outcomes, time.monotonic() - run.began, stopped)


class _Run:
    """State of an execution: waiting jobs, running jobs and outcomes."""

    def __init__(
        self, tasks: Iterable[Task], crew: Crew, store: Store, limit: float | None, common: Row
    ) -> None:
        self.waiting = deque(Job(task) for task in tasks)
        self.total = sum(len(job.task.points) for job in self.waiting)
        self.flying: dict[Future[Attempt], Job] = {}
        self.crew, self.store, self.limit, self.common = crew, store, limit, common
        self.outcomes: Counter[str] = Counter()
        self.began = time.monotonic()
        self.slots, self.looked = 0, -float("inf")

    def until_done(self, told: Deadline) -> None:
        tell = Paced(told)
        while self.waiting or self.flying:
            told.check()
            self._send()
            wait(self.flying, timeout=TURN, return_when=FIRST_COMPLETED)
            self.keep_finished()
            tell(self._line)
        told(self._line())

    def _send(self) -> None:
        """Submit one task per worker and one in reserve, so that no worker is idle."""
        if time.monotonic() - self.looked >= TURN:
            self.slots, self.looked = self.crew.slots(), time.monotonic()
        while self._may_send():
            job = self.waiting.popleft()
            seconds = None if self.limit is None else self.limit * len(job.task.points) + SLACK
            self.flying[self.crew.submit(job.task, seconds)] = job

    def _may_send(self) -> bool:
        """Return True if a task may be submitted.

        A task that may have lost its worker runs alone.
        """
        if not self.waiting or len(self.flying) > self.slots:
            return False
        if self.crew.knows_who or not self.flying:
            return True
        return not (self.waiting[0].was_lost or any(job.was_lost for job in self.flying.values()))

    def keep_finished(self) -> None:
        """Store the records of all completed tasks."""
        finished: list[Finished] = []
        broken: StudyError | None = None
        for future in [future for future in self.flying if future.done()]:
            job = self.flying.pop(future)
            try:
                found = verdict(job, self.crew.attempt(future), self.limit)
            except StudyError as error:  # the rows of others are there all the same
                broken = error
                continue
            finished += found.finished
            self.waiting.extendleft(reversed(found.jobs))
        if finished:
            self.store.append([one._replace(row=self.common | one.row) for one in finished])
            self.outcomes.update(str(one.row[OUTCOME]) for one in finished)
        if broken is not None:
            raise broken

    def _line(self) -> str:
        done, seconds = self.outcomes.total(), time.monotonic() - self.began
        rate = done / seconds if seconds > 0 else 0.0
        left = f"{_duration((self.total - done) / rate)} left" if done else "none yet"
        counted = ", ".join(f"{word} {number}" for word, number in self.outcomes.most_common())
        return f"{done} of {self.total} points, {rate:.3g} a second, {left}; {counted}"


def _duration(seconds: float) -> str:
    for unit, length in (("h", 3600), ("min", 60)):
        if seconds >= 2 * length:
            return f"{seconds / length:.0f} {unit}"
    return f"{seconds:.0f} s"
