"""Where the time of a long piece of work goes: phase by phase, in wall and in CPU time.

Who wants to know holds a `Stopwatch` while the work is done; who does it says in which `phase` it
is. Nobody hands a stopwatch on, and where nobody holds one a phase costs nothing to speak of. The
time of a phase is its own: what phases inside it take is theirs, so that all rows add up.
"""

from __future__ import annotations

import contextlib
import time as clock
from collections.abc import Iterator
from contextvars import ContextVar, Token
from typing import NamedTuple

REST = "everything else"
"""What no phase claims."""


class Seconds(NamedTuple):
    """How long something took; sums are by component."""

    wall: float = 0.0
    """As a person waits."""
    cpu: float = 0.0
    """Of this process, all its threads together."""

    @classmethod
    def now(cls) -> Seconds:
        """Both clocks, of which only differences count."""
        return cls(clock.perf_counter(), clock.process_time())

    @classmethod
    def since_start(cls) -> Seconds:
        """Since this process began; before this module was loaded, CPU time stands for both."""
        now = cls.now()
        return cls(_LOADED.cpu + now.wall - _LOADED.wall, now.cpu)

    def plus(self, begun: Seconds, ended: Seconds) -> Seconds:
        """With what has passed between two readings."""
        return Seconds(self.wall + ended.wall - begun.wall, self.cpu + ended.cpu - begun.cpu)


_LOADED = Seconds.now()


class Stopwatch:
    """Takes the time of every phase of what is done while it is held.

    Attributes
    ----------
    phases : dict of str to Seconds
        In the order in which they began; a phase that comes again adds to its row.

    Examples
    --------
    >>> import ann_dc
    >>> with Stopwatch() as watch:
    ...     solution = ann_dc.solve(ann_dc.plants.double_integrator(N=5))
    >>> [*watch.phases][:4]
    ['everything else', 'stage equations', 'network', 'first run']
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
        """What has passed since the last reading belongs to the phase of the moment."""
        now, name = Seconds.now(), self._within[-1]
        self.phases[name] = self.phases.get(name, Seconds()).plus(self._last, now)
        self._last = now

    def _begin(self, name: str) -> None:
        """From here on it is the phase ``name``, until `_end`."""
        self.lap()
        self.phases.setdefault(name, Seconds())
        self._within.append(name)

    def _end(self) -> None:
        """Back to the phase outside."""
        self.lap()
        self._within.pop()

    def __str__(self) -> str:
        """A row a phase, in milliseconds; what no phase claims and the sum come last."""
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
    """What is done in this block, or in the function below, is a phase of its own.

    Parameters
    ----------
    name : str
        What a table calls it.

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
