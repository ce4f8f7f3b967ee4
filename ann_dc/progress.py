"""What a long piece of work tells while it goes on: a line at a time, and to nobody by default."""

from __future__ import annotations

import time as clock
from collections.abc import Callable
from typing import TypeAlias

Progress: TypeAlias = Callable[[str], None]
"""Takes one line at a time."""

SECONDS = 0.5
"""Between two lines of one loop."""


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
