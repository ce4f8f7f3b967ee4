"""Execution of a study: submission of all tasks and storage of their records.

Tasks run in local processes, in this process, or in any ``concurrent.futures`` executor. A task
without records is repeated or split into smaller tasks, which isolates the failing case.
"""

from __future__ import annotations

import functools
import time
from collections import Counter, deque
from collections.abc import Callable, Iterable
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    ThreadPoolExecutor,
    wait,
)
from typing import Any, NamedTuple

from ann_dc.errors import StudyError, require_positive
from ann_dc.progress import Deadline, Paced, Progress, Stopped, silent
from ann_dc.resources import cores
from ann_dc.study.processes import Apart, attempted_apart, pickled
from ann_dc.study.records import LOST, OUTCOME, SECONDS, TIMED_OUT, Finished, Row, without_result
from ann_dc.study.store import Store
from ann_dc.study.tasks import Attempt, Task, Work, attempted

FIRST = 16
"""Largest number of cases of a task before the duration of a case is known."""
PORTION = 3.0
"""Seconds that a task with several cases should take, so that an interruption loses little."""
PARTS = 8
"""Number of smaller tasks into which a task without records is split."""
SLACK = 1.0
"""Seconds that a task may take in addition to the limits of its cases."""
TURN = 0.2
"""Interval of progress reports and interrupt checks while no task ends, in seconds."""


class _Job(NamedTuple):
    """Task to execute; `was_lost` is True if the task has already lost a worker."""

    task: Task
    was_lost: bool = False


def _verdict(job: _Job, attempt: Attempt, limit: float | None) -> tuple[list[Finished], list[_Job]]:
    """Return the records to store and the jobs to repeat after an attempt.

    A task that lost its worker is repeated once, because the loss may be accidental. After a second
    loss, a time-out or an exception, a task with several cases is split. For a single case the
    outcome is recorded. The `limit` is in seconds per case.

    >>> from ann_dc.study.records import FAILED, Point
    >>> job = _Job(Task((Point(0, {}, 5), Point(1, {}, 6))))
    >>> failed = Attempt([], FAILED, "ValueError: no", {})
    >>> finished, jobs = _verdict(job, failed, None)
    >>> [len(next.task.points) for next in jobs]
    [1, 1]
    >>> _verdict(jobs[1], failed, None)[0][0].row
    {'point': 1, 'seed': 6, 'outcome': 'failed', 'message': 'ValueError: no'}
    """
    if not attempt.outcome:
        return attempt.finished, []
    if attempt.outcome == LOST and not job.was_lost:
        return [], [_Job(job.task, was_lost=True)]
    first, *others = points = job.task.points
    if others:
        size = -(-len(points) // PARTS)
        return [], [_Job(Task(points[at : at + size])) for at in range(0, len(points), size)]
    is_late = attempt.outcome == TIMED_OUT
    message = f"the time limit of {limit:g} s expired" if is_late else attempt.message
    row = without_result(first, attempt.outcome, message).row
    return [Finished(row | attempt.circumstances)], []


class Tally(NamedTuple):
    """Number of records by outcome, wall-clock seconds, and the reason of an early end or ""."""

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
    """Execute all tasks and store their records as soon as a task is complete.

    Tasks of many cases are divided into tasks of about `PORTION` seconds.
    The records do not depend on the executor or on the order. A task is split if it raises, exceeds
    its time limit or loses its worker twice. The splitting isolates the failing case, whose record
    has the outcome ``failed``, ``timed out`` or ``worker lost`` and the reason. The other cases are
    completed. A lost worker is replaced.

    By default `executor` is a number of local processes (`workers`); for Dask use
    ``client.get_executor()``. The `limit` is in seconds per case: a task that exceeds its limit is
    terminated with its process, whatever blocks it. `common` are cells of every record, such as the
    versions. `progress` receives the number of completed cases, the rate, the remaining time and
    the outcomes. It ends the execution by raising `Stopped`; Ctrl-C has the same effect. Records
    stored until then remain.

    Raises `StoreError` if records cannot be stored, for example on a full disk. Raises `StudyError`
    if the executor is broken, or the work cannot be sent or started there.
    """
    if workers is not None:
        require_positive(StudyError, workers=workers)
    if limit is not None:
        require_positive(StudyError, limit=limit)
    crew = _Processes(work, workers) if executor is None else _Foreign(work, executor, workers)
    run = _Run(tasks, crew, store, limit, common or {})
    stopped = ""
    try:
        with Deadline(progress) as deadline:
            run.until_done(deadline)
    except Stopped as reason:
        stopped = str(reason)
        run.keep_finished()
    finally:
        for future in run.flying:
            future.cancel()
        crew.close()
    return Tally(run.outcomes, time.monotonic() - run.began, stopped)


class _Processes:
    """Local processes, each of which can be terminated without effect on the others.

    The default number of workers is the number of processors available to this process.
    """

    attributes_losses = True

    def __init__(self, work: Work, workers: int | None) -> None:
        self._workers = workers or cores()
        self._threads = ThreadPoolExecutor(self._workers, thread_name_prefix="study")
        self._apart = Apart(pickled(work))

    def slots(self) -> int:
        return self._workers

    def submit(self, task: Task, seconds: float | None) -> Future[Attempt]:
        return self._threads.submit(self._apart, task, seconds)

    def attempt(self, future: Future[Attempt]) -> Attempt:
        return future.result()

    def close(self) -> None:
        self._threads.shutdown(wait=False, cancel_futures=True)
        self._apart.close()
        self._threads.shutdown(wait=True)


class _Foreign:
    """Executor of the caller: threads, processes or a cluster; the caller closes it.

    A task with a time limit runs in a separate process next to the executor's worker, which can be
    terminated. The default number of workers is the number that the executor reports.
    """

    attributes_losses = False  # Dask charges all that were waiting for the worker

    def __init__(self, work: Work, executor: Executor, workers: int | None) -> None:
        self._work, self._executor, self._workers = work, executor, workers
        self._client: Any = getattr(executor, "_client", None)
        self._is_dask = hasattr(self._client, "nthreads")
        self._options = {"pure": False} if self._is_dask else {}  # else it repeats a lost result
        self._pickled = b""

    def slots(self) -> int:
        if self._workers is not None:
            return self._workers
        if self._is_dask:  # where workers come and go
            return max(1, sum(self._client.nthreads().values()))
        return getattr(self._executor, "_max_workers", None) or cores()

    def submit(self, task: Task, seconds: float | None) -> Future[Attempt]:
        """Submit a task; raise `StudyError` if the executor accepts none."""
        try:
            submit = functools.partial(self._executor.submit, **self._options)
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
        pass


def _broken(error: Exception) -> StudyError:
    return StudyError(
        f"the executor accepts no more tasks ({type(error).__name__}: {error}); finished cases "
        "are stored: run the study again with another executor, or without"
    )


class _Run:
    """State of an execution: waiting jobs, running jobs and outcomes."""

    def __init__(
        self,
        tasks: Iterable[Task],
        crew: _Processes | _Foreign,
        store: Store,
        limit: float | None,
        common: Row,
    ) -> None:
        self.waiting = deque(_Job(task) for task in tasks)
        self.total = sum(len(job.task.points) for job in self.waiting)
        self.flying: dict[Future[Attempt], _Job] = {}
        self.crew, self.store, self.limit, self.common = crew, store, limit, common
        self.outcomes: Counter[str] = Counter()
        self.each: float | None = None
        self.began = time.monotonic()
        self.slots, self.checked = 0, -float("inf")

    def until_done(self, deadline: Deadline) -> None:
        report = Paced(deadline)
        while self.waiting or self.flying:
            deadline.check()
            self._send()
            wait(self.flying, timeout=TURN, return_when=FIRST_COMPLETED)
            self.keep_finished()
            report(self._line)
        deadline(self._line())

    def _send(self) -> None:
        """Submit one task per worker and one in reserve, so that no worker is idle."""
        if time.monotonic() - self.checked >= TURN:
            self.slots, self.checked = self.crew.slots(), time.monotonic()
        while self._may_send():
            job = self._next()
            seconds = None if self.limit is None else self.limit * len(job.task.points) + SLACK
            self.flying[self.crew.submit(job.task, seconds)] = job

    def _next(self) -> _Job:
        """Return the next job, with no more cases than `PORTION` seconds allow.

        The duration of a case is that of the last task; before the first one it is unknown.
        """
        job = self.waiting.popleft()
        size = FIRST if self.each is None else max(1, int(PORTION / max(self.each, 1e-9)))
        points = job.task.points
        if job.was_lost or len(points) <= size:
            return job
        self.waiting.appendleft(_Job(Task(points[size:])))
        return _Job(Task(points[:size]))

    def _may_send(self) -> bool:
        """Return True if a task may be submitted.

        A task that may have lost its worker runs alone.
        """
        if not self.waiting or len(self.flying) > self.slots:
            return False
        if self.crew.attributes_losses or not self.flying:
            return True
        return not (self.waiting[0].was_lost or any(job.was_lost for job in self.flying.values()))

    def keep_finished(self) -> None:
        """Store the records of all completed tasks."""
        finished: list[Finished] = []
        broken: StudyError | None = None
        for future in [future for future in self.flying if future.done()]:
            job = self.flying.pop(future)
            try:
                attempt = self.crew.attempt(future)
                records, jobs = _verdict(job, attempt, self.limit)
            except StudyError as error:  # other tasks may have records
                broken = error
                continue
            seconds = attempt.circumstances.get(SECONDS)
            if attempt.finished and isinstance(seconds, float):
                self.each = seconds
            finished += records
            self.waiting.extendleft(reversed(jobs))
        if finished:
            self.store.append([one._replace(row=self.common | one.row) for one in finished])
            self.outcomes.update(str(one.row[OUTCOME]) for one in finished)
        if broken is not None:
            raise broken

    def _line(self) -> str:
        done, seconds = self.outcomes.total(), time.monotonic() - self.began
        if not done:
            return f"0 of {self.total} points" + "; designing and compiling" * bool(self.total)
        rate = done / max(seconds, 1e-9)
        left = f"{_duration((self.total - done) / rate)} left"
        counted = ", ".join(f"{word} {number}" for word, number in self.outcomes.most_common())
        return f"{done} of {self.total} points, {rate:.3g} a second, {left}; {counted}"


def _duration(seconds: float) -> str:
    for unit, length in (("h", 3600), ("min", 60)):
        if seconds >= 2 * length:
            return f"{seconds / length:.0f} {unit}"
    return f"{seconds:.0f} s"


class Here(Executor):
    """Serial executor: `submit` runs the call in this process before it returns.

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
