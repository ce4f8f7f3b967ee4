"""Contestants in turns, so that a machine that drifts drifts for all of them alike."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

ROUNDS = 15


@dataclass(frozen=True, kw_only=True, eq=False)
class Contestant:
    """Who takes part.

    Attributes
    ----------
    name : str
    call : callable
        The whole of what is timed.
    remark : str
        How good its answer is.
    cpu, wall : list of float
        Seconds of every round: of all threads of this process, and as a person waits.
    """

    name: str
    call: Callable[[], object]
    remark: str = ""
    cpu: list[float] = field(default_factory=list)
    wall: list[float] = field(default_factory=list)

    @property
    def value(self) -> str:
        """The least CPU time."""
        return f"{1e3 * min(self.cpu):.2f} ms"

    @property
    def times(self) -> str:
        """What the least CPU time is to be read beside, in milliseconds."""
        cpu, wall = (1e3 * np.array(seconds) for seconds in (self.cpu, self.wall))
        return (
            f"median {np.median(cpu):.2f}; wall {wall.min():.2f}, median {np.median(wall):.2f}; "
            f"{self.remark}"
        )


def in_turns(contestants: Sequence[Contestant], rounds: int = ROUNDS) -> None:
    """Time all of them, one call a round each, after a round that does not count.

    Parameters
    ----------
    contestants : sequence of Contestant
        Their ``cpu`` and ``wall`` are filled.
    rounds : int
    """
    for number in range(rounds + 1):
        for one in contestants:
            wall, cpu = time.perf_counter(), time.process_time()
            one.call()
            spent = time.process_time() - cpu, time.perf_counter() - wall
            if number:
                one.cpu.append(spent[0])
                one.wall.append(spent[1])
