"""Stepper of a network whose inputs change over time, and states between its steps."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, final

import numpy as np

from ann_dc.backends.integration.drawing import Pieces, take_step, within_limits
from ann_dc.backends.integration.methods import DOP853, Between, Known, Method
from ann_dc.backends.integration.steppers import Stepper, Steps, limited
from ann_dc.evaluation.drive import Drive, breakpoints
from ann_dc.evaluation.interpreted import InterpretedEvaluator
from ann_dc.network.network import Network


class _Piece(NamedTuple):
    """Polynomial of a step whose time begins at a breakpoint; ``t`` is its end in network time."""

    began: float
    t: float
    inside: Callable[[np.ndarray], np.ndarray]

    def __call__(self, times: np.ndarray) -> np.ndarray:
        """Return the states (n, K) at network times (K,)."""
        return self.inside(times - self.began)


@final
class DrivenStepper(Stepper):
    """SciPy solvers from breakpoint to breakpoint of the inputs, between which these are smooth."""

    def __init__(
        self, drive: Drive, method: Method, until: float, start: tuple[float, np.ndarray]
    ) -> None:
        self._drive, self._compiled = drive, drive.evaluator
        self._method = method if method.rows is None else replace(method, solver=DOP853.solver)
        self.time, self.state = start
        times = breakpoints(self._compiled.network.waveforms, until)
        self._ends = times[times > self.time].tolist()
        self._pieces: list[_Piece] = []
        self._lost: np.ndarray | None = None
        self._begin()

    @property
    def between(self) -> Between:
        """Polynomials of the steps."""
        return Pieces(pieces=self._pieces, compiled=self._compiled)

    def go_on(self, until: float) -> None:
        """Add a piece up to a later time."""
        self._ends, self.at_end = [*self._ends, until], False
        self._begin()

    def _begin(self) -> None:
        """Start at a breakpoint, with a time of its own, up to just before the next one."""
        self._began, self._until = self.time, self._ends.pop(0)
        length = self._until - self._began
        self._set(0.0)
        method, start = self._method, self.state
        if method.implicit:
            self._solver: Any = limited(
                self._compiled, method, self._slope, start, length, self._set
            )
        else:
            options: dict[str, Any] = {"rtol": method.rtol, "atol": method.atol}
            self._solver = method.scipys(self._slope, 0.0, start, length, **options)

    def _set(self, time: float) -> None:
        """Set the inputs to a time since the last breakpoint, before the next one."""
        self._drive(min(self._began + time, float(np.nextafter(self._until, 0.0))))

    def _slope(self, time: float, x: np.ndarray) -> np.ndarray:
        self.evaluations += 1
        self._set(time)
        slope = self._compiled.rhs(x)
        if not np.isfinite(slope).all():
            self._lost = np.array(x)
        return slope

    def steps(self, most: int) -> Steps:
        """Take one step; return no row if it fails."""
        message = take_step(self._solver, self._method, self._compiled, np.inf)
        if self._solver.status == "failed":
            self.failed, self.beyond = message or "the integration method failed", self._lost
            return np.empty(0), np.empty((0, 2)), np.empty((0, self.state.size))
        is_over, inside = self._solver.status == "finished", self._solver.dense_output()
        self._pieces.append(_Piece(self._began, self._began + inside.t, inside))
        self.time = self._until if is_over else self._began + float(self._solver.t)
        self.state = within_limits(self._compiled, self._solver.y)
        if not np.isfinite(self.state).all():  # LSODA accepts such a step
            self.beyond = self._lost
        self._set(float(self._solver.t))
        residuals = self._compiled.residuals(self.state)
        self.at_end = is_over and not self._ends
        if is_over and self._ends:
            self._begin()
        return np.array([self.time]), np.array([residuals]), np.array([self.state])


@dataclass(frozen=True, kw_only=True, eq=False)
class DrivenAgain:
    """Function that integrates gaps between known states again, with inputs over time."""

    network: Network
    method: Method

    def __call__(self, known: Known, times: np.ndarray) -> np.ndarray:
        """Return states (K, n) at rising times between the known ones."""
        at, states = known
        drive = Drive(InterpretedEvaluator(self.network))
        gaps = np.clip(np.searchsorted(at, times, side="right") - 1, 0, len(at) - 2)
        found = np.empty((len(times), states.shape[1]))
        with np.errstate(all="ignore"):
            for gap in np.unique(gaps):
                start = float(at[gap]), states[gap]
                stepper = DrivenStepper(drive, self.method, float(at[gap + 1]), start)
                while not (stepper.at_end or stepper.failed):
                    stepper.steps(1)
                chosen = gaps == gap
                found[chosen] = stepper.between(known, times[chosen])
        return found
