"""Timing of long tasks by phase, in wall-clock and CPU time.

The caller opens a `Stopwatch` during the task, and the code of the task declares its `phase`. A
stopwatch is not passed as an argument, and without one a phase has negligible cost. The time of a
phase excludes nested phases, so that all rows add up.
"""

from __future__ import annotations

import contextlib
import time as clock
from collections.abc import Iterator
from contextvars import ContextVar, Token
from typing import NamedTuple

REST = "everything else"
"""Name of the time outside all phases."""


class Seconds(NamedTuple):
    """Duration in seconds; sums are by component."""

    wall: float = 0.0
    """Wall-clock time."""
    cpu: float = 0.0
    """CPU time of this process, over all threads."""

    @classmethod
    def now(cls) -> Seconds:
        """Return the readings of both clocks, of which only differences are meaningful."""
        return cls(clock.perf_counter(), clock.process_time())

    @classmethod
    def since_start(cls) -> Seconds:
        """Return the time since the start of this process.

        For the time before this module was loaded, the CPU time is used for both clocks.
        """
        now = cls.now()
        return cls(_LOADED.cpu + now.wall - _LOADED.wall, now.cpu)

    def plus(self, begun: Seconds, ended: Seconds) -> Seconds:
        """Return this duration plus the difference of two readings."""
        return Seconds(self.wall + ended.wall - begun.wall, self.cpu + ended.cpu - begun.cpu)


_LOADED = Seconds.now()


class Stopwatch:
    """Timer of every phase of the work in its ``with`` block.

    Attributes
    ----------
    phases : dict of str to Seconds
        Time by phase, in order of first start; a repeated phase adds to its row.

    Examples
    --------
    >>> import ann_dc
    >>> with Stopwatch() as watch:
    ...     solution = ann_dc.solve(ann_dc.plants.double_integrator(N=5))
    >>> [*watch.phases][:4]
    ['everything else', 'stage equations', 'network', 'gain-scheduled run']
    >>> all(seconds.wall >= 0 for seconds in watch.phases.values())
    True
    """

    def __init__(self) -> None:
        self.phases: dict[str, Seconds] = {}
        self._within = [REST]
        self._last = Seconds.now()
        self._token: Token[Stopwatch | None] | None = None

    def __enter__(self) -> Stopwatch:
        self._last, self._token = Seconds.now(), _held.set(self)
        return self

    def __exit__(self, *error: object) -> None:
        self.lap()
        if self._token is not None:
            _held.reset(self._token)

    def lap(self) -> None:
        """Add the time since the last reading to the current phase."""
        now, name = Seconds.now(), self._within[-1]
        self.phases[name] = self.phases.get(name, Seconds()).plus(self._last, now)
        self._last = now

    def _begin(self, name: str) -> None:
        """Start the phase ``name``, which lasts until `_end`."""
        self.lap()
        self.phases.setdefault(name, Seconds())
        self._within.append(name)

    def _end(self) -> None:
        """Return to the enclosing phase."""
        self.lap()
        self._within.pop()

    def __str__(self) -> str:
        """Return one row per phase in milliseconds, then the unassigned time and the sum."""
        rows = {name: spent for name, spent in self.phases.items() if name != REST}
        rows[REST] = self.phases.get(REST, Seconds())
        rows["together"] = Seconds(*map(sum, zip(*rows.values())))
        lines = [f"{'ms':20}{'wall':>9}{'CPU':>9}"]
        for name, (wall, cpu) in rows.items():
            lines.append(f"{name:20}{1e3 * wall:9.1f}{1e3 * cpu:9.1f}")
        return "\n".join(lines)


_held: ContextVar[Stopwatch | None] = ContextVar("stopwatch", default=None)


@contextlib.contextmanager
def phase(name: str) -> Iterator[None]:
    """Time a ``with`` block, or a decorated function, as a phase of the given name.

    Examples
    --------
    >>> @phase("sums")
    ... def total(numbers):
    ...     return sum(numbers)
    >>> with Stopwatch() as watch:
    ...     three = total([1, 2])
    >>> three, [*watch.phases]
    (3, ['everything else', 'sums'])
    """
    watch = _held.get()
    if watch is None:
        yield
        return
    watch._begin(name)
    try:
        yield
    finally:
        watch._end()
