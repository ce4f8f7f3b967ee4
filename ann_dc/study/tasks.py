"""Tasks (cases that are executed together) and attempts at them, as plain data."""

from __future__ import annotations

import os
import platform
import time
from collections.abc import Callable
from typing import NamedTuple, TypeAlias

from ann_dc.errors import AnnDcError
from ann_dc.study.columns import plain_row
from ann_dc.study.records import (
    FAILED,
    HOST,
    LOST,
    OUTCOME,
    POINT,
    SECONDS,
    WORKER,
    Finished,
    Point,
    Row,
)

LONGEST = 1000
"""Largest number of characters of a message in a cell."""


class Task(NamedTuple):
    """Cases that are executed together."""

    points: tuple[Point, ...]


Work: TypeAlias = Callable[[Task], list[Finished]]
"""Callable that executes a task. It returns a record per case, independent of the other cases."""


class Attempt(NamedTuple):
    """Result of one attempt at a task.

    There is one record per case, or none. Without records the outcome is `FAILED`, `TIMED_OUT` or
    `LOST`, and the message gives the reason. The circumstances are those of `circumstances`.
    """

    finished: list[Finished]
    outcome: str
    message: str
    circumstances: Row


def attempted(work: Work, task: Task) -> Attempt:
    """Execute a task in this process; exceptions are returned in the attempt.

    >>> def work(task):
    ...     return [Finished({"point": 3, "outcome": "settled"})]
    >>> attempted(work, Task((Point(3, {}, 7),))).outcome
    ''
    >>> attempted(work, Task((Point(4, {}, 7),))).message
    'the task returned records of other cases: [3]'
    """
    began = time.monotonic()
    try:
        finished = [Finished(plain_row(one.row), one.curves) for one in work(task)]
        found = sorted((one.row.get(POINT), bool(one.row.get(OUTCOME))) for one in finished)
        if found == sorted((point.number, True) for point in task.points):
            outcome, message = "", ""
        else:
            numbers = [one.row.get(POINT) for one in finished]
            finished, outcome = [], FAILED
            message = f"the task returned records of other cases: {numbers}"
    except MemoryError as error:
        finished, outcome, message = [], LOST, sentence(error)
    except (Exception, SystemExit) as error:
        finished, outcome, message = [], FAILED, sentence(error)
    seconds = (time.monotonic() - began) / max(1, len(task.points))
    cells = circumstances(os.getpid(), seconds)
    finished = [one._replace(row=cells | one.row) for one in finished]
    return Attempt(finished, outcome, message[:LONGEST], cells)


def circumstances(process: int | None, seconds: float) -> Row:
    """Return the cells of process, host and seconds per case."""
    return {SECONDS: seconds, WORKER: str(process), HOST: platform.node()}


def sentence(error: BaseException) -> str:
    """Return the description of an error on one line."""
    reason, name = " ".join(str(error).split()), type(error).__name__
    if isinstance(error, AnnDcError):
        return reason or name
    return f"{name}: {reason}".removesuffix(": ")
