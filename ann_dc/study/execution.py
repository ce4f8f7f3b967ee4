"""Execution of a study: submission of all tasks and storage of their records.

A task without records is repeated or split into smaller tasks, which isolates the failing case.
"""

from __future__ import annotations

import time
from collections import Counter, deque
from collections.abc import Iterable
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from typing import NamedTuple

from ann_dc.errors import StudyError, require_positive
from ann_dc.progress import Deadline, Paced, Progress, Stopped, silent
from ann_dc.study.executors import Crew, Foreign, Processes
from ann_dc.study.records import LOST, OUTCOME, TIMED_OUT, Finished, Row, without_result
from ann_dc.study.store import Store
from ann_dc.study.tasks import Attempt, Task, Work

PARTS = 8
"""Number of smaller tasks into which a task without records is split."""
SLACK = 1.0
"""Seconds that a task may take in addition to the limits of its cases."""
TURN = 0.2
"""Interval of progress reports and interrupt checks while no task ends, in seconds."""


class Job(NamedTuple):
    """Task to execute; `was_lost` is True if the task has already lost a worker."""

    task: Task
    was_lost: bool = False


def verdict(job: Job, attempt: Attempt, limit: float | None) -> tuple[list[Finished], list[Job]]:
    """Return the records to store and the jobs to repeat after an attempt.

    A task that lost its worker is repeated once, because the loss may be accidental. After a second
    loss, a time-out or an exception, a task with several cases is split. For a single case the
    outcome is recorded. The `limit` is in seconds per case.

    Examples
    --------
    >>> from ann_dc.study.records import FAILED, Point
    >>> job = Job(Task((Point(0, {}, 5), Point(1, {}, 6))))
    >>> failed = Attempt([], FAILED, "ValueError: no", {})
    >>> finished, jobs = verdict(job, failed, None)
    >>> [len(next.task.points) for next in jobs]
    [1, 1]
    >>> verdict(jobs[1], failed, None)[0][0].row
    {'point': 1, 'seed': 6, 'outcome': 'failed', 'message': 'ValueError: no'}
    """
    if not attempt.outcome:
        return attempt.finished, []
    if attempt.outcome == LOST and not job.was_lost:
        return [], [Job(job.task, was_lost=True)]
    first, *others = points = job.task.points
    if others:
        size = -(-len(points) // PARTS)
        return [], [Job(Task(points[at : at + size])) for at in range(0, len(points), size)]
    is_late = attempt.outcome == TIMED_OUT
    message = f"{limit:g} s were over (limit)" if is_late else attempt.message
    row = without_result(first, attempt.outcome, message).row
    return [Finished(row | attempt.circumstances)], []


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
                records, jobs = verdict(job, self.crew.attempt(future), self.limit)
            except StudyError as error:  # other tasks may have records
                broken = error
                continue
            finished += records
            self.waiting.extendleft(reversed(jobs))
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
