"""States of an integration between its steps, computed only on request.

Every gap between two known states is integrated again with the method and tolerances of the run.
States behind a failing step are nan. The polynomials of an implicit solver are stored instead,
since a multistep solver cannot begin in the middle of a run.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ann_dc.backends.integration.integrator import Course, Ends, draw, share_of_tolerance
from ann_dc.backends.integration.methods import Known, Method
from ann_dc.backends.integration.systems import Cells
from ann_dc.evaluation.codegen.evaluator import fast_evaluator
from ann_dc.evaluation.contract import Evaluator
from ann_dc.network.network import Network

PIECES = 20_000_000
"""Largest count of numbers in the polynomials of an implicit run; a longer run stores none."""


@dataclass(frozen=True, kw_only=True, eq=False)
class CompiledAgain:
    """Function that integrates gaps again in compiled code, by a method with a tableau."""

    network: Network
    method: Method
    cells: Cells = Cells.WHERE_POSSIBLE

    def __call__(self, known: Known, times: np.ndarray) -> np.ndarray:
        """Return states (K, n) at rising times between the known ones."""
        (at, states), method = known, self.method
        compiled, rows = fast_evaluator(self.network), method.rows
        assert rows is not None
        integrand = self.cells.integrand(compiled, compiled.domain_guard(states[0]))
        course = Course.at(integrand.state(states[0]), integrand.length, rows, 1.0)
        ends = Ends(0.0, 0.0, np.inf, method.rtol, method.atol)
        places = integrand.system.ghost + integrand.chosen
        return draw(integrand.system, rows, course, ends, places, (at, states), times)


@dataclass(frozen=True, kw_only=True, eq=False)
class SolvedAgain:
    """Function that integrates gaps again with an explicit SciPy solver."""

    method: Method
    rhs: Callable[[np.ndarray], np.ndarray]
    compiled: Evaluator

    def __call__(self, known: Known, times: np.ndarray) -> np.ndarray:
        """Return states (K, n) at rising times between the known ones."""
        at, states = known
        gaps = np.clip(np.searchsorted(at, times, side="right") - 1, 0, len(at) - 2)
        found = np.empty((len(times), states.shape[1]))
        with np.errstate(all="ignore"):
            for gap in np.unique(gaps):
                chosen = np.flatnonzero(gaps == gap)
                length = float(at[gap + 1] - at[gap])
                pieces = self._pieces(states[gap], length)
                found[chosen] = _in_pieces(pieces, times[chosen] - at[gap], found.shape[1])
        return within_limits(self.compiled, found)

    def _pieces(self, x: np.ndarray, length: float) -> list[Any]:
        """Return the polynomials of all steps over a length of time from a state."""
        method, pieces = self.method, []
        solver = method.scipys(
            lambda _, x: self.rhs(x), 0.0, x, length,
            rtol=method.rtol, atol=method.atol, first_step=length,
        )  # fmt: skip
        while solver.status == "running":
            take_step(solver, method, self.compiled, max(self.compiled.residuals(solver.y)))
            if solver.status != "failed":
                pieces.append(solver.dense_output())
        return pieces


@dataclass(frozen=True, kw_only=True, eq=False)
class Pieces:
    """Polynomials of an implicit SciPy solver, one for each step."""

    pieces: Sequence[Any]
    compiled: Evaluator

    def __call__(self, known: Known, times: np.ndarray) -> np.ndarray:
        """Return states (K, n) at rising times."""
        return within_limits(self.compiled, _in_pieces(self.pieces, times, known[1].shape[1]))


def _in_pieces(pieces: Sequence[Any], times: np.ndarray, size: int) -> np.ndarray:
    """Return states (K, size) at rising times (K,), nan behind the last polynomial.

    ``pieces`` are consecutive `scipy.integrate.DenseOutput` objects.
    """
    found = np.full((len(times), size), np.nan)
    numbers = np.searchsorted([piece.t for piece in pieces], times)
    for number in np.unique(numbers[numbers < len(pieces)]):
        chosen = slice(*np.searchsorted(numbers, [number, number + 1]))
        found[chosen] = pieces[number](times[chosen]).T
    return found


def take_step(solver: Any, method: Method, compiled: Evaluator, worst: float) -> str | None:
    """Take a step of a SciPy solver and clip its state; return the message of a failed step.

    The tolerance of an explicit method shrinks with the larger residual ``worst`` at the start of
    the step, as in `integrator.advance`. A solver that stores the slope receives that of the
    clipped state.
    """
    if not method.implicit:
        share = share_of_tolerance(worst, method.rtol)
        solver.rtol, solver.atol = method.rtol * share, method.atol * share
    try:
        message = solver.step()
    except (RuntimeError, ValueError) as error:  # of a Jacobian that is not finite, by its LU
        solver.status, message = "failed", f"matrix of an implicit step: {error}"
    within = within_limits(compiled, solver.y)
    if "f" in vars(solver) and not np.array_equal(within, solver.y):
        solver.y, solver.f = within, solver.fun(solver.t, within)
    return message


def within_limits(compiled: Evaluator, x: np.ndarray) -> np.ndarray:
    """Return states (..., n) clipped to the saturation limits."""
    low, high = compiled.tape.limits[compiled.tape.places[:, 0]].T
    return np.clip(x, low, high)
