"""A study is done: tasks go out, rows come in and are kept, until there is nothing left to do."""

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
"""Seconds that a task may take beside the limits of its points."""
TURN = 0.2
"""Seconds after which progress is told and an interrupt is noticed, even if no task ends."""


class Tally(NamedTuple):
    """What was done.

    Attributes
    ----------
    outcomes : Counter of str
        Rows by outcome.
    seconds : float
        That it took.
    stopped : str
        Why it ended before the last point was done; empty if it did not.
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
    """Do all tasks and keep a row for each of their points, as soon as it is there.

    The rows are the same whoever does them and in whatever order. A task that raises, overruns its
    time or loses its worker twice is split until the guilty point is alone, whose row then says
    ``failed``, ``timed out`` or ``worker lost``, and why; the others are done. A worker that is
    gone is replaced.

    Parameters
    ----------
    tasks : iterable of Task
        Whose points have no row yet.
    work : callable
        Does a task: gives a `Finished` for each of its points. It is sent to other processes.
    store : Store
        With the columns `HEAD`, of the settings and of the metrics, and `TAIL`.
    executor : concurrent.futures.Executor, optional
        Processes of our own by default. Dask's is ``client.get_executor()``.
    workers : int, optional
        How many tasks are done at a time.
    limit : float, optional
        Seconds a point. It holds whatever hangs: what overruns it is ended with its process.
    common : Row, optional
        Cells of every row, as the versions.
    progress : Progress
        Is told how many points are done, at what rate, how long it takes still, and the outcomes.
        It ends the work by raising `Stopped`, and Ctrl-C does; the rows until then are kept.

    Returns
    -------
    Tally

    Raises
    ------
    StoreError
        If rows cannot be kept, on a full disk for instance; those from before are.
    StudyError
        If the executor is broken, or the work cannot be sent or begun there.
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
    """What is to be done, what is being done, and what was."""

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
        """Give each of those at work a task, and one more so that none waits for it."""
        if time.monotonic() - self.looked >= TURN:
            self.slots, self.looked = self.crew.slots(), time.monotonic()
        while self._may_send():
            job = self.waiting.popleft()
            seconds = None if self.limit is None else self.limit * len(job.task.points) + SLACK
            self.flying[self.crew.submit(job.task, seconds)] = job

    def _may_send(self) -> bool:
        """Whether another task may go out; one that may have lost its worker does so alone."""
        if not self.waiting or len(self.flying) > self.slots:
            return False
        if self.crew.knows_who or not self.flying:
            return True
        return not (self.waiting[0].was_lost or any(job.was_lost for job in self.flying.values()))

    def keep_finished(self) -> None:
        """Keep the rows of all tasks that are done by now."""
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
