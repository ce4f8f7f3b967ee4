"""What follows from an attempt: rows, or smaller tasks: only the guilty point is charged."""

from __future__ import annotations

from typing import NamedTuple

from ann_dc.study.records import LOST, TIMED_OUT, Finished, Row, without_result
from ann_dc.study.task_results import Attempt, Task

PARTS = 8
"""Smaller tasks that a task is split into which as a whole gave no rows."""


class Job(NamedTuple):
    """A task that has to be done, with what it has behind it.

    Attributes
    ----------
    task : Task
    was_lost : bool
        Whether it has taken a worker along already.
    """

    task: Task
    was_lost: bool = False


class Verdict(NamedTuple):
    """What an attempt leads to.

    Attributes
    ----------
    finished : list of Finished
        Rows that are to be kept.
    jobs : list of Job
        What is to be done next.
    """

    finished: list[Finished]
    jobs: list[Job]


def verdict(job: Job, attempt: Attempt, limit: float | None) -> Verdict:
    """What is kept of an attempt, and what is to be done again.

    A worker may be lost by accident: its task is done once more. Then, and where its time is over
    or it raises, a task of many points is split; of one point alone the outcome is the row's.

    Parameters
    ----------
    job : Job
    attempt : Attempt
    limit : float or None
        Seconds a point.

    Examples
    --------
    >>> from ann_dc.study.records import FAILED, Point
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
