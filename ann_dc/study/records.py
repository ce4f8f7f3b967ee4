"""What a study asks for and gets back: points, each a setting with a seed, and a row for each."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple, TypeAlias

Value: TypeAlias = float | int | str | bool | None
"""What a cell of the table holds; None where there is none, nan among it."""

Row: TypeAlias = dict[str, Value]
"""A point with its setting, how it ended, and what was measured: values by column."""

POINT, SEED, OUTCOME, MESSAGE = "point", "seed", "outcome", "message"
SECONDS, WORKER, HOST, VERSIONS = "wall_time", "worker", "host", "versions"
HEAD = (POINT, SEED)
"""Columns before those of the setting."""
TAIL = (OUTCOME, MESSAGE, SECONDS, WORKER, HOST, VERSIONS)
"""Columns behind those of the metrics."""
CIRCUMSTANCES = (SECONDS, WORKER, HOST)
"""Columns that differ from run to run of the same study."""

FAILED, TIMED_OUT, LOST = "failed", "timed out", "worker lost"
"""Outcomes of points that have no result, beside those of `Outcome`."""


class Point(NamedTuple):
    """One point of a study.

    Attributes
    ----------
    number : int
        From zero on, in the order of the design.
    setting : mapping of str to Value
        What is set there, by name.
    seed : int
        Of all that is drawn there.
    """

    number: int
    setting: Mapping[str, Value]
    seed: int


class Finished(NamedTuple):
    """What became of a point.

    Attributes
    ----------
    row : Row
        With a value for every column, circumstances too.
    curves : bytes
        An ``.npz`` file of what it did over time; empty where nothing is kept.
    """

    row: Row
    curves: bytes = b""


def without_result(point: Point, outcome: str, message: str) -> Finished:
    """The row of a point that gave none.

    Parameters
    ----------
    point : Point
    outcome : str
    message : str
        Why, in a sentence.

    Examples
    --------
    >>> without_result(Point(3, {"input.q_d.x": 2.0}, 7), TIMED_OUT, "60 s were over").row
    {'point': 3, 'seed': 7, 'input.q_d.x': 2.0, 'outcome': 'timed out', 'message': '60 s were over'}
    """
    told = {OUTCOME: outcome, MESSAGE: message}
    return Finished({POINT: point.number, SEED: point.seed, **point.setting, **told})
