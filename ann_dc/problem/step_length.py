r"""Optimised step length: one number for all stages, between two bounds.

Bounds of a state would be rows of every stage. The network optimises an angle z instead, which
gives the step length

.. math::
    h = \tfrac{low + high}{2} + \tfrac{high - low}{2} \sin(z + z_0), \qquad
    h = low + c\,(\sqrt{(z + \sqrt 3)^2 + 1} - 1)

where the second form applies without an upper bound. The step length satisfies its bounds for every
z, and z = 0 is the guess.

At a bound the slope is zero and the curvature is not. An optimum at a bound is therefore a
stationary point with a finite z, and the network settles there as usual. A map that reaches its
bounds at infinity, such as tanh, would let z drift indefinitely.

The declaration contains the user's states and z, which is free at both ends and whose map is the
identity. A completed declaration is not changed, so `dataclasses.replace` works.

References
----------
.. [1] F. James, M. Roos, Minuit: a system for function minimization and analysis of the parameter
   errors and correlations, Computer Physics Communications 10, 1975, 343-367: the same two maps.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import sympy as sp

from ann_dc.errors import ProblemError
from ann_dc.problem.fields import check_names, is_vector, one_a_state, positive, smooth_expression

SUFFIX = "_free"
"""Suffix of the symbol's name that gives the name of z."""
SCALE = math.pi
"""Scale of z, the distance from bound to bound that a network value of 1 represents."""
FIRST_GUESS = 10.0
"""Ratio of the guess to the lower bound without an upper bound."""
AT_BOUND = 1e-6
"""Fraction of the distance from bound to guess below which a step length is at its bound."""


class Coordinate(sp.Symbol):
    """State z of an optimised step length, distinguished from user states by its type."""

    __slots__ = ()


@dataclass(frozen=True, kw_only=True, eq=False)
class StepLength:
    """Optimised sampling interval: ``dt=StepLength(low=0.02, high=0.5)``.

    Every realisation represents the interval as one more state, carried unchanged from stage to
    stage and free at both ends. This costs four neurons per stage; a bus along the network would
    cost one in total. However, the wires only reach the next stage, so all cells remain alike.
    Preconditioners, circuits and weight files therefore need no extension. An `InitialGuess` has
    one more row for z, the last one, zero at the guess.

    Parameters
    ----------
    low : float
        Lower bound, positive, in the unit of dt.
    high : float, optional
        Upper bound; none by default.
    guess : float, optional
        Initial value between the bounds. By default the geometric mean of the bounds, or ten times
        the lower bound.
    symbol : sympy.Symbol or str
        Name of the interval in the problem's formulas, "h" by default.

    Raises
    ------
    ProblemError
        If a bound is not positive or not finite, or if bounds and guess contradict each other.

    Examples
    --------
    A mass that stops after one metre, with a cost rate of time in addition to effort:

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
                    f"dt.low, dt.high: the lower bound {self.low:g} is not below the upper "
                    f"bound {self.high:g}; use low < high, or dt=number for a fixed step length"
                )
        middle = FIRST_GUESS * self.low if self.high is None else math.sqrt(self.low * self.high)
        put("guess", positive("dt.guess", middle if self.guess is None else self.guess))
        if not self.low < self.guess < (self.high or math.inf):  # pyright: ignore
            raise ProblemError(
                f"dt.guess: {self.guess:g} is not between the bounds ({self}); a network cannot "
                "leave a bound at which it starts"
            )
        given = sp.Symbol(self.symbol) if isinstance(self.symbol, str) else self.symbol
        if not isinstance(given, sp.Symbol):
            raise ProblemError(f'dt.symbol: expected a name such as "h", got {self.symbol!r}')
        check_names([given], [])
        put("symbol", given)

    @property
    def coordinate(self) -> Coordinate:
        """Carried state z: the symbol's name with the suffix "_free"."""
        return Coordinate(f"{self.symbol}{SUFFIX}")

    @property
    def expression(self) -> sp.Expr:
        """Step length h as a formula of `coordinate`."""
        return self._map(self.coordinate, sp)

    def length(self, z: Any) -> np.ndarray:
        """Return h for values of z.

        Parameters
        ----------
        z : array_like
            Values of the carried state (...,); the result has the same shape.

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
        """Return the bound at which a step length lies: "lower", "upper" or "".

        Parameters
        ----------
        length : float
            Step length in the unit of dt.

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
    """Return a positive number or a `StepLength` unchanged, or raise a `ProblemError`."""
    return given if isinstance(given, StepLength) else positive("dt", given)


def stage_times(dt: float | StepLength, q: np.ndarray) -> np.ndarray:
    """Return the limits (N+1,) of stages in time, from 0, in the unit of dt.

    The last row of the states q (n, N+1) contains an optimised step length.
    """
    if isinstance(dt, StepLength):
        return np.append(0.0, np.cumsum(dt.length(q[-1, :-1])))
    return dt * np.arange(q.shape[-1])


def mean_length(dt: float | StepLength, q: np.ndarray) -> float:
    """Return the length of a stage: dt, or the mean of an optimised step length in q (n, N+1).

    The optimised lengths of all stages are equal after settling.
    """
    return float(stage_times(dt, q)[-1]) / (q.shape[-1] - 1) if isinstance(dt, StepLength) else dt


@dataclass(frozen=True, kw_only=True, eq=False)
class HandedOn:
    """Completion of a declaration with the carried state, if the step length is optimised.

    `own` are the user's states.
    """

    own: tuple[sp.Symbol, ...]
    step: StepLength | None

    @classmethod
    def of(cls, states: tuple[sp.Symbol, ...], dt: float | StepLength) -> HandedOn:
        """Return the completion of a declaration, with or without the carried state.

        Raises `ProblemError` if a carried state exists but the step length is now given.
        """
        if isinstance(dt, StepLength):
            own = states[:-1] if states[-1] == dt.coordinate else states
            return cls(own=own, step=dt)
        if isinstance(states[-1], Coordinate):
            raise ProblemError(
                f"dt: got {dt:g}, but the step length of this problem is free (state "
                f"{states[-1]}); declare the problem with formulas in which the step is a number"
            )
        return cls(own=states, step=None)

    @property
    def states(self) -> tuple[sp.Symbol, ...]:
        """States of the completed declaration, n in total."""
        return self.own if self.step is None else (*self.own, self.step.coordinate)

    @property
    def symbols(self) -> tuple[sp.Symbol, ...]:
        """Symbols that formulas may name in addition to states, controls and inputs."""
        return () if self.step is None else (self.step.symbol,)  # type: ignore[return-value]

    @property
    def units(self) -> dict[str, str]:
        """Unit of the carried state, which is dimensionless."""
        return {} if self.step is None else {str(self.step.coordinate): "1"}

    def check_symbol(self, given: Sequence[sp.Symbol]) -> None:
        """Raise a `ProblemError` if the step length's symbol is among the given ones."""
        for symbol in self.symbols:
            if symbol.name.lower() in [s.name.lower() for s in given]:
                raise ProblemError(
                    f"dt.symbol: {symbol} is a symbol of the problem; rename the step "
                    'length, for instance StepLength(..., symbol="step")'
                )

    def stage_map(
        self, dynamics: Any, map: Any, known: set[sp.Symbol]
    ) -> tuple[str, tuple[sp.Expr, ...]]:
        """Return "dynamics" or "map" and its n checked components.

        Raises `ProblemError` if neither or both are given, or if the number of components is wrong.
        """
        if (dynamics is None) == (map is None):
            raise ProblemError(
                f"dynamics, map: {'neither' if map is None else 'both'} given; declare the "
                f"continuous right-hand side as dynamics= or the map q_{{k+1}} = f(q, u) as "
                "map=, one of the two"
            )
        name, given = ("map", map) if dynamics is None else ("dynamics", dynamics)
        last = self.states[-1] if dynamics is None else sp.S.Zero
        given = self.of_own(given, last)
        if not is_vector(given, len(self.own)):
            raise ProblemError(
                f"{name}: {len(self.own)} expressions expected, one for each state "
                f"({', '.join(str(s) for s in self.own)}), but got {given!r}"
            )
        checked = [smooth_expression(f"{name}[{s}]", e, known) for s, e in zip(self.own, given)]
        return name, self.after(checked, last)

    def end(self, name: str, given: Any) -> tuple[Any, ...]:
        """Return the values of q_0 or q_d per state, None if free.

        A missing q_d is free in all components. Raises `ProblemError` for invalid values.
        """
        if given is None and name == "q_d":
            given = (None,) * len(self.own)
        return self.after(one_a_state(name, self.of_own(given, None), self.own), None)

    def of_own(self, given: Any, last: Any) -> Any:
        """Return the values of the user's states, without the value of a carried state.

        The carried state is recognised by its value ``last``.
        """
        completed = self.step is not None and is_vector(given, len(self.own) + 1)
        return given[: len(self.own)] if completed and _is(given[len(self.own)], last) else given

    def after(self, checked: Sequence[Any], last: Any) -> tuple[Any, ...]:
        """Return the checked values of the user's states, plus ``last`` if completed."""
        return tuple(checked) if self.step is None else (*checked, last)


def _is(value: Any, last: Any) -> bool:
    return value is None if last is None else bool(value == last)
