"""Cases of a study (a setting with a seed) and their records."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple, TypeAlias

Value: TypeAlias = float | int | str | bool | None
"""Content of a cell. None represents a missing value and nan."""

Row: TypeAlias = dict[str, Value]
"""Record of a case by column: setting, outcome and measured values."""

POINT, SEED, OUTCOME, MESSAGE = "point", "seed", "outcome", "message"
SECONDS, WORKER, HOST, VERSIONS = "wall_time", "worker", "host", "versions"
HEAD = (POINT, SEED)
"""Columns before those of the setting."""
TAIL = (OUTCOME, MESSAGE, SECONDS, WORKER, HOST, VERSIONS)
"""Columns after those of the metrics."""
CIRCUMSTANCES = (SECONDS, WORKER, HOST)
"""Columns that differ between runs of the same study."""

FAILED, TIMED_OUT, LOST = "failed", "timed out", "worker lost"
"""Outcomes of cases without a result, in addition to those of `Outcome`."""


class Point(NamedTuple):
    """Case of a study: index in the plan, values by setting name, seed of all random quantities."""

    number: int
    setting: Mapping[str, Value]
    seed: int


class Finished(NamedTuple):
    """Record of a case, and its trajectories as an ``.npz`` file (empty if not stored)."""

    row: Row
    curves: bytes = b""


def without_result(point: Point, outcome: str, message: str) -> Finished:
    """Return the record of a case without a result; the message gives the reason.

    >>> without_result(Point(3, {"input.q_d.x": 2.0}, 7), TIMED_OUT, "60 s expired").row
    {'point': 3, 'seed': 7, 'input.q_d.x': 2.0, 'outcome': 'timed out', 'message': '60 s expired'}
    """
    end = {OUTCOME: outcome, MESSAGE: message}
    return Finished({POINT: point.number, SEED: point.seed, **point.setting, **end})
