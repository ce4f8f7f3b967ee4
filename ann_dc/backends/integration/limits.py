"""Implicit integration with saturation limits and located switching instants.

A neuron at a limit is fixed until it leaves the limit. Its slope jumps to zero there. The equations
of an implicit step then have no solution, however short the step. Between two such instants the
equations are smooth: a saturated neuron has slope zero, and every other neuron moves without a
limit. A step that passes an instant ends right before it, located on the solver's polynomial, and
the solver restarts right behind it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from scipy import sparse

from ann_dc.evaluation.codegen.evaluator import FastEvaluator

INSIDE = 1e-12
"""Evaluation distance of an unsaturated neuron from its limit, relative to the limit."""
HALVINGS = 50
"""Number of halvings of a step by which an instant is located."""


class Piece(NamedTuple):
    """States within a step that ends at a time t."""

    t: float  # network time at the end of the step
    states: Callable[[Any], np.ndarray]  # states at times within the step

    def __call__(self, times: Any) -> np.ndarray:
        """Return the state (n,) at a time, or the states (n, K) at K times."""
        return self.states(times)


class LimitedSolver:
    """Implicit SciPy solver that restarts when a neuron reaches or leaves a limit.

    ``solver`` makes a `scipy.integrate.OdeSolver` from a right-hand side, its Jacobian, a time, a
    state and the end time. ``jacobian`` makes a Jacobian, a callable (time, state), for a mask (n,)
    of saturated neurons.
    """

    def __init__(
        self,
        compiled: FastEvaluator,
        solver: Callable[..., Any],
        rhs: Callable[[float, np.ndarray], np.ndarray],
        jacobian: Callable[[np.ndarray], Callable[[float, np.ndarray], Any]],
        start: np.ndarray,
        until: float,
    ) -> None:
        self._low, self._high = compiled.tape.limits[compiled.tape.places[:, 0]].T
        self._solver, self._rhs, self._jacobian = solver, rhs, jacobian
        self._held, self._began = np.zeros(len(start), bool), start
        self._instant: tuple[float, np.ndarray] | None = None
        self._until = until
        self._begin(0.0, start)

    def __getattr__(self, name: str) -> Any:
        """Return an attribute of the inner solver, such as its tolerances."""
        return getattr(self.__dict__["_inner"], name)

    @property
    def status(self) -> str:
        """Status as defined by SciPy: running, finished or failed."""
        return "running" if self._instant is not None else self._inner.status

    @status.setter
    def status(self, status: str) -> None:
        """Set the status of the inner solver."""
        self._inner.status = status

    @property
    def t_bound(self) -> float:
        """End of the integration in network time."""
        return self._until

    @t_bound.setter
    def t_bound(self, until: float) -> None:
        """Increase the end time."""
        self._until = self._inner.t_bound = until

    def step(self) -> str | None:
        """Take a step up to the first instant within it, or restart behind an instant."""
        if self._instant is not None:
            self._begin(*self._instant)
            return None
        inner = self._inner
        began, message = inner.t, inner.step()
        self.t, self.y = float(inner.t), _kept(inner.y, self._held, self._began)
        if inner.status != "failed":
            inside, held, start = inner.dense_output(), self._held, self._began
            self._polynomial = Piece(self.t, lambda times: _kept(inside(times), held, start))
            if self._changes(self.t, self.y):
                self._stop_before_the_first_change(began)
        return message

    def dense_output(self) -> Piece:
        """Return the states within the last step."""
        return self._polynomial

    def _begin(self, time: float, x: np.ndarray) -> None:
        x = np.clip(_kept(x, self._held, self._began), self._low, self._high)
        held = self._at_rest(time, x)
        self._held, self._began = held, x
        free, jacobian_of = sparse.diags_array((~held).astype(float)), self._jacobian(held)

        def slope(t: float, x: np.ndarray) -> np.ndarray:
            return np.where(held, 0.0, self._rhs(t, self._within(x)))

        def slope_by_state(t: float, x: np.ndarray) -> Any:
            jacobian = jacobian_of(t, self._within(x))
            if sparse.issparse(jacobian):
                return sparse.csc_matrix(free @ jacobian)
            return np.where(held[:, None], 0.0, jacobian)

        self._inner, self._instant = self._solver(slope, slope_by_state, time, x, self._until), None
        before, self.t, self.y = getattr(self, "y", x), time, x
        self._polynomial = Piece(time, lambda times: _jump(times, time, before, x))

    def _within(self, x: np.ndarray) -> np.ndarray:
        """Return a state with saturated neurons at their limits and all others inside."""
        room = [INSIDE * np.maximum(np.abs(end), 1.0) for end in (self._low, self._high)]
        low, high = (np.where(np.isfinite(r), r, 0.0) for r in room)
        inside = np.clip(x, self._low + low, self._high - high)
        return np.where(self._held, self._began, inside)

    def _at_rest(self, time: float, x: np.ndarray) -> np.ndarray:
        """Mark neurons (n,) at or beyond a limit that the saturation rule retains there."""
        x = np.clip(x, self._low, self._high)
        return ((x >= self._high) | (x <= self._low)) & (self._rhs(time, x) == 0)

    def _changes(self, time: float, x: np.ndarray) -> bool:
        if not (self._held | (x >= self._high) | (x <= self._low)).any():
            return False
        return not np.array_equal(self._at_rest(time, x), self._held)

    def _stop_before_the_first_change(self, before: float) -> None:
        after, states = self.t, self._polynomial.states
        for _ in range(HALVINGS):
            middle = 0.5 * (before + after)
            if self._changes(middle, states(middle)):
                after = middle
            else:
                before = middle
        self.t, self.y, self._instant = before, states(before), (after, states(after))
        self._polynomial = Piece(before, states)


def _kept(x: np.ndarray, held: np.ndarray, began: np.ndarray) -> np.ndarray:
    """Return states (n,) or (n, K) with saturated neurons at their restart values.

    Rounding must not move a saturated neuron: 1e-45 off its limit, it would count as free.
    """
    held, began = (part.reshape(-1, *(1,) * (x.ndim - 1)) for part in (held, began))
    return np.where(held, began, x)


def _jump(times: Any, instant: float, before: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Return a state (n,) or states (n, K) at times on either side of an instant."""
    late = np.asarray(times) >= instant
    return np.where(late, *(state.reshape(-1, *(1,) * late.ndim) for state in (x, before)))
