"""What every planner is asked and answers, whatever it plans with."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from ann_dc.navigation.scenario import World


class Situation(NamedTuple):
    """What a robot knows at the beginning of a control period.

    Attributes
    ----------
    world : World
    number : int
        Of the journey, under which a planner keeps what it remembers.
    q : (n,) array
        Where the robot is.
    time : float
        In seconds.
    """

    world: World
    number: int
    q: np.ndarray
    time: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Plan:
    """What a planner would do.

    Attributes
    ----------
    q : (n, K+1) array
        States, beginning with the present one.
    u : (m, K) array
        Controls.
    residual : float
        How far the plan is from being an optimum; nan where nothing measures it.
    spent : float
        Fastest time constants that the network ran.
    pressed : float
        Largest multiplier of an obstacle's row, in shares of its price; zero without contact.
    """

    q: np.ndarray
    u: np.ndarray
    residual: float = float("nan")
    spent: float = 0.0
    pressed: float = 0.0


class Driver(Protocol):
    """A planner on its way through some worlds at once; it remembers its last plans."""

    def plan(self, situations: Sequence[Situation]) -> list[Plan]:
        """A plan for each situation."""
        ...


class Planner(Protocol):
    """Plans a few steps ahead, again and again."""

    @property
    def dt(self) -> float:
        """The control period, in seconds."""
        ...

    def begin(self) -> Driver:
        """A driver that remembers nothing yet."""
        ...
