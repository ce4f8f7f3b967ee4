"""Interface of all planners: situations and plans."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from ann_dc.navigation.scenario import Scenario


class Situation(NamedTuple):
    """Information that a robot has at a time (s) at the beginning of a control period.

    ``number`` is that of the journey, the key of the planner's memory; ``q`` (n,) is the state.
    """

    world: Scenario
    number: int
    q: np.ndarray
    time: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Plan:
    """Planned states q (n, K+1), beginning with the current one, and controls u (m, K).

    Attributes
    ----------
    residual : float
        Optimality residual of the plan; nan if the planner does not compute it.
    spent : float
        Run time of the network in fastest time constants.
    relative_multiplier : float
        Largest multiplier of an obstacle constraint relative to its penalty weight; zero without
        contact.
    """

    q: np.ndarray
    u: np.ndarray
    residual: float = float("nan")
    spent: float = 0.0
    relative_multiplier: float = 0.0


class Driver(Protocol):
    """Planner in operation in several worlds, with a memory of the last plans."""

    def plan(self, situations: Sequence[Situation]) -> list[Plan]:
        """Return a plan for each situation."""
        ...


class Planner(Protocol):
    """Receding-horizon planner."""

    @property
    def dt(self) -> float:
        """Control period, in seconds."""
        ...

    def begin(self) -> Driver:
        """Return a driver without previous plans."""
        ...
