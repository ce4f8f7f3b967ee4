"""Batches of cases: cases of equal wiring run together, one batch lane each.

A batch has the same samples regardless of the executor and of earlier runs. The remainder of an
interrupted batch starts from the same base, so its records are identical bit for bit.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Set

from ann_dc.study.records import Point, Value
from ann_dc.study.settings import CIRCUITS, FAMILIES, Effect, backend_of
from ann_dc.study.tasks import Task

BATCH = 500
"""Largest number of cases in a batch."""


def shared(point: Point) -> tuple[tuple[str, Value], ...]:
    """Return the settings common to all cases of a batch: all except network numbers."""
    numbers = tuple(f"{word}." for word, f in FAMILIES.items() if f.effect is Effect.NUMBERS)
    return tuple(sorted(item for item in point.setting.items() if not item[0].startswith(numbers)))


def is_batched(point: Point) -> bool:
    """Return True if a case runs in generated code, in a batch."""
    setting = point.setting
    if backend_of(setting) in CIRCUITS:
        return False
    return setting.get("design.form") != "S16"


def tasks(points: Iterable[Point], finished: Set[int]) -> Iterator[Task]:
    """Yield tasks for all cases whose numbers are not in `finished`."""
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
