r"""A step length that is chosen with the rest: one number for all stages, between two bounds.

Bounds of a state would be rows of every stage; the network chooses an angle z instead, from which
the step length follows,

.. math::
    h = \tfrac{low + high}{2} + \tfrac{high - low}{2} \sin(z + z_0), \qquad
    h = low + c\,(\sqrt{(z + \sqrt 3)^2 + 1} - 1)

where there is no upper bound: h keeps to its bounds whatever z is, and z = 0 is the guess. At a
bound the slope is zero and the curvature is not, so an optimum that lies there is a stationary
point with a finite z, to which a network settles as to any other (a map that reaches its bounds at
infinity, as tanh, would leave z drifting for ever).

References
----------
.. [1] F. James, M. Roos, Minuit: a system for function minimization and analysis of the parameter
   errors and correlations, Computer Physics Communications 10, 1975, 343-367: the same two maps.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import sympy as sp

from ann_dc.errors import ProblemError
from ann_dc.problem.fields import check_names, positive

SUFFIX = "_free"
"""What is added to the symbol's name to name z."""
SCALE = math.pi
"""How far z goes, from bound to bound: what a network value of 1 stands for."""
FIRST_GUESS = 10.0
"""The guess over the lower bound, where there is no upper one."""
AT_BOUND = 1e-6
"""Share of the way from bound to guess below which a step length is at its bound."""


class Coordinate(sp.Symbol):
    """The state z of a step length that is chosen, told from a user's state by its type."""

    __slots__ = ()


@dataclass(frozen=True, kw_only=True, eq=False)
class StepLength:
    """A sampling interval that the network chooses: ``dt=StepLength(low=0.02, high=0.5)``.

    Every realisation has it as one more state, which every stage hands on unchanged and which is
    free at both ends. That costs four neurons a stage, where a bus along the row would cost one in
    all; but their wires reach the next stage and no further, so that a cell stays like the others
    and metrics, circuits and weight files need nothing new. A `Start` has a row for it, the last
    one, zero at the guess.

    Parameters
    ----------
    low : float
        Lower bound, positive, in the unit of dt.
    high : float, optional
        Upper bound; none by default.
    guess : float, optional
        Where a network starts, between the bounds. The geometric mean of the bounds by default, or
        ten times the lower one.
    symbol : sympy.Symbol or str
        What the problem's formulas may call it, "h" by default.

    Raises
    ------
    ProblemError
        If a bound is not positive or not finite, or they contradict each other or the guess.

    Examples
    --------
    A mass that is to stop after one metre, where every second costs as much as an effort:

    >>> import ann_dc
    >>> x, v, a, h = sp.symbols("x v a h")
    >>> problem = ann_dc.OptimalControlProblem(
    ...     states=(x, v), controls=(a,), dynamics=(v, a), dt=StepLength(low=0.02, high=0.5),
    ...     cost=h * (1 + a**2 / 2), horizon=20, q_0=(0, 0), q_d=(1, 0))
    >>> solution = ann_dc.solve(problem)
    >>> round(solution.step_length, 4), round(solution.total_time, 3), solution.certified
    (0.1031, 2.061, True)
    """

    low: float
    high: float | None = None
    guess: float | None = None
    symbol: sp.Symbol | str = "h"

    def __post_init__(self) -> None:
        put = lambda key, value: object.__setattr__(self, key, value)  # noqa: E731
        put("low", positive("dt.low", self.low))
        if self.high is not None:
            put("high", positive("dt.high", self.high))
            if not self.low < self.high:
                raise ProblemError(
                    f"dt.low, dt.high: the lower bound {self.low:g} is not below the upper bound "
                    f"{self.high:g}; give low < high, or dt=number for a step length that is given"
                )
        middle = FIRST_GUESS * self.low if self.high is None else math.sqrt(self.low * self.high)
        put("guess", positive("dt.guess", middle if self.guess is None else self.guess))
        if not self.low < self.guess < (self.high or math.inf):  # pyright: ignore
            raise ProblemError(
                f"dt.guess: {self.guess:g} is not between the bounds ({self}); a network cannot "
                "leave a bound on which it starts"
            )
        given = sp.Symbol(self.symbol) if isinstance(self.symbol, str) else self.symbol
        if not isinstance(given, sp.Symbol):
            raise ProblemError(f'dt.symbol: expected a name such as "h", got {self.symbol!r}')
        check_names([given], [])
        put("symbol", given)

    @property
    def coordinate(self) -> Coordinate:
        """z, the state that is handed on: the symbol's name with "_free"."""
        return Coordinate(f"{self.symbol}{SUFFIX}")

    @property
    def expression(self) -> sp.Expr:
        """h as a formula of `coordinate`."""
        return self._map(self.coordinate, sp)

    def length(self, z: Any) -> np.ndarray:
        """h (...,) from values of z (...,).

        Parameters
        ----------
        z : array_like

        Examples
        --------
        >>> StepLength(low=0.1, high=0.4).length([0.0, 1.0]).round(3)
        array([0.2  , 0.342])
        """
        return np.asarray(self._map(np.asarray(z, float), np))

    def _map(self, z: Any, library: Any) -> Any:
        low, guess = float(self.low), float(self.guess)  # type: ignore[arg-type]
        if self.high is None:
            c = guess - low
            return low + c * (library.sqrt((z + math.sqrt(3)) ** 2 + 1) - 1)
        middle, half = 0.5 * (low + self.high), 0.5 * (self.high - low)
        return middle + half * library.sin(z + math.asin((guess - middle) / half))

    def bound_at(self, length: float) -> str:
        """Which bound a step length lies at: "lower", "upper", or nothing.

        Parameters
        ----------
        length : float

        Examples
        --------
        >>> step = StepLength(low=0.1, high=0.4)
        >>> step.bound_at(0.4), step.bound_at(0.3)
        ('upper', '')
        """
        guess = float(self.guess)  # type: ignore[arg-type]
        if length - self.low < AT_BOUND * (guess - self.low):
            return "lower"
        if self.high is not None and self.high - length < AT_BOUND * (self.high - guess):
            return "upper"
        return ""

    def __str__(self) -> str:
        if self.high is None:
            return f"at least {self.low:g}"
        return f"{self.low:g} to {self.high:g}"


def step_length(given: Any) -> float | StepLength:
    """A sampling interval: a positive number, or a `StepLength` as it is; or a ProblemError."""
    return given if isinstance(given, StepLength) else positive("dt", given)


def stage_times(dt: float | StepLength, q: np.ndarray) -> np.ndarray:
    """When stages begin and end (N+1,), from 0 on, in the unit of dt.

    Parameters
    ----------
    dt : float or StepLength
    q : (n, N+1) array
        States; the last of them knows the step length where it is chosen.

    Examples
    --------
    >>> stage_times(0.5, np.zeros((2, 3))).tolist()
    [0.0, 0.5, 1.0]
    """
    if isinstance(dt, StepLength):
        return np.append(0.0, np.cumsum(dt.length(q[-1, :-1])))
    return dt * np.arange(q.shape[-1])


def mean_length(dt: float | StepLength, q: np.ndarray) -> float:
    """Length of a stage: dt, or the mean of what was chosen (one number, where it has settled).

    Parameters
    ----------
    dt : float or StepLength
    q : (n, N+1) array
        States; the last of them knows the step length where it is chosen.
    """
    return float(stage_times(dt, q)[-1]) / (q.shape[-1] - 1) if isinstance(dt, StepLength) else dt
