"""Progress messages of long tasks, one line at a time; silent by default.

The receiver may raise `Stopped`: the task ends there, and `solve` returns the present state.
`Deadline` does so when the time limit expires or on Ctrl-C.
"""

from __future__ import annotations

import signal
import threading
import time as clock
from collections.abc import Callable
from types import FrameType
from typing import Any, TypeAlias

from ann_dc.errors import AnnDcError

Progress: TypeAlias = Callable[[str], None]
"""Receiver of one line at a time."""

SECONDS = 0.5
"""Smallest time in seconds between two lines of one loop."""


class Stopped(AnnDcError):
    """Raised by a progress receiver to end the work early; the text gives the reason."""


class Deadline:
    """Progress receiver that ends the work at a time limit, or at a first Ctrl-C.

    The limit is in seconds from now on, infinite for none. Within its ``with`` block an interrupt
    in the main thread is recorded and ends the work at the next line. A second interrupt takes
    effect at once. A line received after the limit raises `Stopped`.

    Examples
    --------
    >>> with Deadline(silent, seconds=0.0) as progress:
    ...     progress("gain-scheduled run: step 25")
    Traceback (most recent call last):
    ann_dc.progress.Stopped: the time limit of 0 s expired
    """

    def __init__(self, progress: Progress, seconds: float = float("inf")) -> None:
        self.progress, self.seconds = progress, seconds
        self.end, self.allowed = clock.monotonic() + seconds, f"{seconds:g} s"
        self.interrupted = False
        self._before: Any = None

    def early(self, share: float) -> Deadline:
        """Return a deadline at a fraction of the time, to leave time for a later part."""
        left = (1 - share) * self.seconds if self.seconds < float("inf") else 0.0
        sooner = Deadline(self, self.seconds - left)
        sooner.end = self.end - left
        sooner.allowed = f"{sooner.seconds:g} s (part of {self.allowed})"
        return sooner

    def __call__(self, line: str) -> None:
        """Check the deadline, then pass a line to the receiver."""
        self.check()
        self.progress(line)

    def check(self) -> None:
        """Raise `Stopped` if the time limit has expired or the user has interrupted."""
        if self.interrupted:
            raise Stopped("interrupted")
        if clock.monotonic() >= self.end:
            raise Stopped(f"the time limit of {self.allowed} expired")

    def __enter__(self) -> Deadline:
        before = signal.getsignal(signal.SIGINT)
        nested = isinstance(getattr(before, "__self__", None), Deadline)  # the outer one notes it
        alone = threading.current_thread() is threading.main_thread()
        if alone and callable(before) and not nested:
            self._before = before
            signal.signal(signal.SIGINT, self._interrupt)
        return self

    def __exit__(self, *error: object) -> None:
        if self._before is not None:
            signal.signal(signal.SIGINT, self._before)
            self._before = None

    def _interrupt(self, number: int, frame: FrameType | None) -> None:
        if self.interrupted:
            self._before(number, frame)
        self.interrupted = True


def silent(line: str) -> None:
    """Ignore a ``line``; the default, without progress."""


class Paced:
    """Progress receiver for short loop iterations: at most one line per interval.

    The smallest interval between two lines is `SECONDS` by default.

    Examples
    --------
    >>> reported = []
    >>> loop = Paced(reported.append, seconds=0.0)
    >>> for turn in range(2):
    ...     loop(lambda: f"turn {turn}")
    >>> reported
    ['turn 0', 'turn 1']
    """

    def __init__(self, progress: Progress, seconds: float = SECONDS) -> None:
        self.progress, self.seconds, self.last = progress, seconds, clock.monotonic()

    def __call__(self, line: Callable[[], str]) -> None:
        """Send ``line()``, which is evaluated only then, if the interval has elapsed."""
        if clock.monotonic() - self.last >= self.seconds:
            self.last = clock.monotonic()
            self.progress(line())
