"""Which points are done together: those that share a wiring are one batch, a lane each.

A batch has the same samples whoever runs it and whatever was done before: what is left of it after
an interruption is run from the same base, so that its rows come out the same, bit for bit.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Set

from ann_dc.study.records import Point, Value
from ann_dc.study.settings import CIRCUITS, FAMILIES, Effect, backend_of
from ann_dc.study.task_results import Task

BATCH = 500
"""Points of a batch, at most."""


def shared(point: Point) -> tuple[tuple[str, Value], ...]:
    """What points of a batch have in common: all but numbers of the same network.

    Parameters
    ----------
    point : Point
    """
    numbers = tuple(f"{word}." for word, f in FAMILIES.items() if f.effect is Effect.NUMBERS)
    return tuple(sorted(item for item in point.setting.items() if not item[0].startswith(numbers)))


def is_batched(point: Point) -> bool:
    """Whether a point runs in generated code, many at a time.

    Parameters
    ----------
    point : Point
    """
    setting = point.setting
    if backend_of(setting) in CIRCUITS:
        return False
    return setting.get("design.form") != "S16"


def tasks(points: Iterable[Point], finished: Set[int]) -> Iterator[Task]:
    """Work for all points that are not finished.

    Parameters
    ----------
    points : iterable of Point
    finished : set of int
        Numbers of points that are done.
    """
    open_points = (point for point in points if point.number not in finished)
    batch: list[Point] = []
    for point in open_points:
        if not is_batched(point):
            yield Task((point,))
        elif batch and (len(batch) == BATCH or shared(batch[0]) != shared(point)):
            yield Task(tuple(batch))
            batch = [point]
        else:
            batch.append(point)
    if batch:
        yield Task(tuple(batch))
