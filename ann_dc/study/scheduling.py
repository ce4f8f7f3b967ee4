"""Evaluation of attempts: records to store, or smaller tasks to isolate a failure."""

from __future__ import annotations

from typing import NamedTuple

from ann_dc.study.records import LOST, TIMED_OUT, Finished, Row, without_result
from ann_dc.study.task_results import Attempt, Task

PARTS = 8
"""Number of smaller tasks into which a task without records is split."""


class Job(NamedTuple):
    """Task to execute, with its history.

    Attributes
    ----------
    was_lost : bool
        True if the task has already lost a worker.
    """

    task: Task
    was_lost: bool = False


class Verdict(NamedTuple):
    """Result of the evaluation of an attempt.

    Attributes
    ----------
    finished : list of Finished
        Records to store.
    jobs : list of Job
        Jobs to execute next.
    """

    finished: list[Finished]
    jobs: list[Job]


def verdict(job: Job, attempt: Attempt, limit: float | None) -> Verdict:
    """Return the records to store and the jobs to repeat after an attempt.

    A task that lost its worker is repeated once, because the loss may be accidental. After a second
    loss, a time-out or an exception, a task with several cases is split. For a single case the
    outcome is recorded. The `limit` is in seconds per case.

    Examples
    --------
    >>> from ann_dc.study.keeping import FAILED, Point
    >>> job = Job(Task((Point(0, {}, 5), Point(1, {}, 6))))
    >>> failed = Attempt([], FAILED, "ValueError: no", {})
    >>> [len(next.task.points) for next in verdict(job, failed, None).jobs]
    [1, 1]
    >>> verdict(verdict(job, failed, None).jobs[1], failed, None).finished[0].row
    {'point': 1, 'seed': 6, 'outcome': 'failed', 'message': 'ValueError: no'}
    """
    if not attempt.outcome:
        return Verdict(attempt.finished, [])
    if attempt.outcome == LOST and not job.was_lost:
        return Verdict([], [Job(job.task, was_lost=True)])
    if len(job.task.points) > 1:
        return Verdict([], [Job(part) for part in _parts(job.task)])
    message = attempt.message
    if attempt.outcome == TIMED_OUT:
        message = f"{limit:g} s were over (limit)"
    row = _row(job.task, attempt.outcome, message, attempt.circumstances)
    return Verdict([Finished(row)], [])


def _parts(task: Task) -> list[Task]:
    points = task.points
    size = -(-len(points) // PARTS)
    return [Task(points[first : first + size]) for first in range(0, len(points), size)]


def _row(task: Task, outcome: str, message: str, circumstances: Row) -> Row:
    return without_result(task.points[0], outcome, message).row | circumstances
