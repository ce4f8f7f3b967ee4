"""What a long piece of work tells while it goes on: a line at a time, and to nobody by default.

Whoever is told may answer by raising `Stopped`: the work ends there, and `solve` hands back what
it has so far. `Deadline` does so when time is up, or when someone presses Ctrl-C.
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
"""Takes one line at a time."""

SECONDS = 0.5
"""Between two lines of one loop."""


class Stopped(AnnDcError):
    """Work was ended before its end, by whoever was told of its progress; the text says why."""


class Deadline:
    """A progress that ends the work when time is up, or at a first Ctrl-C.

    Within its ``with`` an interrupt in the main thread is noted and ends the work at the next
    line; a second one interrupts at once.

    Parameters
    ----------
    progress : Progress
        Takes the lines meanwhile.
    seconds : float
        From now on; infinite for no limit.

    Raises
    ------
    Stopped
        When it is told a line too late.

    Examples
    --------
    >>> with Deadline(silent, seconds=0.0) as progress:
    ...     progress("first run: step 25")
    Traceback (most recent call last):
    ann_dc.progress.Stopped: 0 s were over (limit)
    """

    def __init__(self, progress: Progress, seconds: float = float("inf")) -> None:
        self.progress, self.seconds = progress, seconds
        self.end, self.allowed = clock.monotonic() + seconds, f"{seconds:g}"
        self.interrupted = False
        self._before: Any = None

    def early(self, share: float) -> Deadline:
        """A deadline that comes after a share of the seconds, so that a later part has some."""
        left = (1 - share) * self.seconds if self.seconds < float("inf") else 0.0
        sooner = Deadline(self, self.seconds - left)
        sooner.end, sooner.allowed = self.end - left, f"{sooner.seconds:g} of {self.allowed}"
        return sooner

    def __call__(self, line: str) -> None:
        """Hand a line on."""
        self.check()
        self.progress(line)

    def check(self) -> None:
        """Go on, or end the work.

        Raises
        ------
        Stopped
            If time is up, or someone has interrupted.
        """
        if self.interrupted:
            raise Stopped("it was interrupted")
        if clock.monotonic() >= self.end:
            raise Stopped(f"{self.allowed} s were over (limit)")

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
    """Tell nobody about a ``line``."""


class Paced:
    """Tells a line every `SECONDS` at most: for loops whose turns are short.

    Parameters
    ----------
    progress : Progress
        Takes a line.
    seconds : float
        Least time between two lines.

    Examples
    --------
    >>> told = []
    >>> loop = Paced(told.append, seconds=0.0)
    >>> for turn in range(2):
    ...     loop(lambda: f"turn {turn}")
    >>> told
    ['turn 0', 'turn 1']
    """

    def __init__(self, progress: Progress, seconds: float = SECONDS) -> None:
        self.progress, self.seconds, self.last = progress, seconds, clock.monotonic()

    def __call__(self, line: Callable[[], str]) -> None:
        """Tell ``line()``, which is written only then, if it is time."""
        if clock.monotonic() - self.last >= self.seconds:
            self.last = clock.monotonic()
            self.progress(line())
