"""The network in continuous time: SciPy's ODE solvers on the compiled right-hand side.

A run ends by settling, not at a guessed horizon: the residual has to fall below the tolerance and
then go on falling to a small share of it, so that a residual which merely hovers is not
taken for a settled network. The settling time is the last exit, never the first crossing.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, TypeAlias

import numpy as np
from scipy import integrate, sparse
from scipy.integrate._ivp.rk import RungeKutta

from ann_dc.backends import status
from ann_dc.backends.recorder import Recorder
from ann_dc.backends.run import Run
from ann_dc.backends.settling import HEADWAY, Settling, window_of
from ann_dc.backends.status import OVERFLOW, Outcome, Status
from ann_dc.evaluation.compiled import CompiledEvaluator
from ann_dc.evaluation.reference import evaluator
from ann_dc.hints.checked import checked
from ann_dc.hints.values import Count, Positive, PositiveFinite
from ann_dc.hints.words import such_as
from ann_dc.network.metrics.contract import ALL_KINDS, Kind
from ann_dc.network.network import Network
from ann_dc.progress import Paced, Progress, Stopped, silent

DENSE_JACOBIAN = 400
"""Largest network whose Jacobian is handed to an implicit solver as a dense matrix."""
SHRINK = 1e-3
"""An explicit method's relative tolerance, at most, as a share of the residual."""
CRAWL = 1000
"""Steps that have to take at least one fastest time constant (of the start) together."""

RightHandSide: TypeAlias = Callable[[np.ndarray], np.ndarray]
"""dx/ds (n,) of a state vector (n,)."""


@such_as("ann_dc.ode.RK45")
@checked
@dataclass(frozen=True, kw_only=True, eq=False)
class Method:
    """An integration method of SciPy with its tolerances.

    Attributes
    ----------
    solver : type
        A subclass of `scipy.integrate.OdeSolver`.
    rtol, atol : float
        Relative and absolute tolerance a step, the latter in network units; `OdeBackend` makes
        those of an explicit method smaller as the residual falls.
    implicit : bool
        Whether the solver takes the exact Jacobian.

    Examples
    --------
    >>> from ann_dc.backends import DOP853
    >>> DOP853.name, DOP853.tighter(100.0).rtol
    ('DOP853', 1e-08)
    """

    solver: type[integrate.OdeSolver]
    rtol: PositiveFinite = 1e-6
    atol: PositiveFinite = 1e-10
    implicit: bool = False

    @property
    def name(self) -> str:
        """SciPy's name of the method."""
        return self.solver.__name__

    @checked
    def tighter(self, factor: PositiveFinite = 100.0) -> Method:
        """The same method with both tolerances smaller by a factor; rtol is at least 3e-14."""
        return replace(self, rtol=max(self.rtol / factor, 3e-14), atol=self.atol / factor)


RK23 = Method(solver=integrate.RK23)
RK45 = Method(solver=integrate.RK45)
DOP853 = Method(solver=integrate.DOP853)
RADAU = Method(solver=integrate.Radau, implicit=True)
BDF = Method(solver=integrate.BDF, implicit=True)
LSODA = Method(solver=integrate.LSODA, implicit=True)

METHODS = {m.name: m for m in (RK23, RK45, DOP853, RADAU, BDF, LSODA)}
"""SciPy's methods by name, for the command line."""


@checked
@dataclass(frozen=True, kw_only=True, eq=False)
class OdeBackend:
    """Runs networks in continuous time: dx/ds = M d(x) by one of SciPy's methods.

    Attributes
    ----------
    method : Method
        `RK45` by default; an implicit one (`RADAU`, `BDF`, `LSODA`) for stiff networks.
    settling : Settling
        When the run counts as settled.
    limit : float
        Longest run, in fastest time constants of the network at its start.
    most_steps : int
        Largest number of integration steps.
    verify : bool
        Repeat a settled run at 100 times tighter tolerances and compare the settling times.
    progress : Progress
        Told one line every half second.

    Examples
    --------
    >>> import ann_dc
    >>> problem = ann_dc.plants.double_integrator(N=5)
    >>> network = ann_dc.design(problem, kinds=[ann_dc.Kind.TIME_CONSTANTS]).network
    >>> run = ann_dc.OdeBackend(method=ann_dc.ode.DOP853, verify=False).run(network)
    >>> run.status.settled
    True
    >>> 0 < run.settling_time < run.status.time  # it went on, to be sure of the last exit
    True
    """

    method: Method = RK45
    settling: Settling = field(default_factory=Settling)
    limit: Positive = 20_000.0
    most_steps: Count = 50_000
    verify: bool = True
    progress: Progress = silent

    @property
    def kinds(self) -> tuple[Kind, ...]:
        """All metrics: equations can be integrated with any."""
        return ALL_KINDS

    @checked
    def run(self, network: Network) -> Run:
        """Integrate from the network's start until it settles, diverges, or time is up.

        Returns
        -------
        Run
            Settled or not: see its ``status``. A method that fails counts as diverged; a run that
            makes no headway, or whose steps become very short, as stalled.
        """
        return self.follow(network)

    @checked
    def follow(self, network: Network, rhs: RightHandSide | None = None) -> Run:
        """As `run`, on another right-hand side; for studies of what is no network.

        Parameters
        ----------
        network : Network
            Says where to start, what has settled and what has left its domain.
        rhs : RightHandSide, optional
            By default the network's own, which alone comes with its Jacobian.

        Returns
        -------
        Run
            In ``verified`` it is told what a run at tighter tolerances said.
        """
        run = _Integration(network, self, rhs).run()
        if not run.status.settled or not self.verify:
            return run
        tight = _Integration(network, replace(self, method=self.method.tighter()), rhs).run()
        if tight.status.outcome is Outcome.STOPPED:
            return replace(
                run, verified=f"{run.verified}; {tight.status}, so no second run checks it"
            )
        change = abs(tight.settling_time - run.settling_time) / max(run.settling_time, 1e-300)
        agrees = tight.status.settled and change < 0.02
        verdict = "agrees" if agrees else "does NOT agree"
        return replace(
            run,
            verified=(
                f"{run.verified}; a run at 100 times tighter tolerances {verdict} "
                f"({tight.settling_time:.5g} against {run.settling_time:.5g})"
            ),
        )


class _Integration:
    """One integration, step by step."""

    def __init__(self, network: Network, backend: OdeBackend, rhs: RightHandSide | None) -> None:
        self.network, self.backend = network, backend
        self.compiled = CompiledEvaluator(network)
        self.rhs = rhs or self.compiled.rhs
        self.evaluations = 0
        start = network.start_state
        self.guard = self.compiled.domain_guard(start)
        self.largest = OVERFLOW * max(float(np.abs(start).max(initial=0.0)), 1.0)
        method = backend.method
        self.fastest = 1 / self.compiled.fastest_rate(start)
        end = backend.limit * self.fastest
        options: dict[str, Any] = {"rtol": method.rtol, "atol": method.atol}
        if method.implicit and rhs is None:
            options["jac"] = self._jacobian
        self.solver = method.solver(self._rhs, 0.0, start, end, **options)
        self.recorder = Recorder(network)
        self.recorder.record(0.0, start, self.compiled.residuals(start))

    def _rhs(self, _, x: np.ndarray) -> np.ndarray:
        self.evaluations += 1
        return self.rhs(x)

    def _jacobian(self, _, x: np.ndarray):
        jacobian = evaluator(self.network).metric @ self.compiled.drive_jacobian(x)
        dense = self.network.size <= DENSE_JACOBIAN or self.backend.method.solver is integrate.LSODA
        return jacobian.toarray() if dense else sparse.csc_matrix(jacobian)

    def run(self) -> Run:
        """Step until the end is known."""
        ended, paced = None, Paced(self.backend.progress)
        with np.errstate(all="ignore"):
            while ended is None:
                ended = self._step()
                try:
                    paced(self._line)
                except Stopped as end:
                    ended = ended or self._told(status.stopped, str(end))
        now, settling = float(self.solver.t), self.backend.settling
        return self.recorder.run(now, self.solver.y, ended, settling, self.evaluations)

    def _line(self) -> str:
        worst = max(self.recorder.residuals[-1])
        return f"{float(self.solver.t):.4g} unit time constants, KKT residual {worst:.1e}"

    def _step(self) -> Status | None:
        message = self.solver.step()
        x, now = self.solver.y, float(self.solver.t)
        residuals = self.compiled.residuals(x)
        if isinstance(self.solver, RungeKutta):
            # At its stability limit an explicit method hovers at an error of its tolerance; let
            # that shrink with the residual, so that it never stands in for the network's own.
            method = self.backend.method
            share = max(min(1.0, SHRINK * max(residuals) / method.rtol), 3e-14 / method.rtol)
            self.solver.rtol, self.solver.atol = method.rtol * share, method.atol * share
        self.recorder.record(now, x, residuals)
        if max(residuals) < self.backend.settling.tolerance * self.backend.settling.confirm:
            return status.settled(max(residuals), now)
        return self._failure(x, now, message)

    def _failure(self, x: np.ndarray, now: float, message: str | None) -> Status | None:
        size = float(np.abs(x).max())
        if self.solver.status == "failed" or not size < self.largest:
            return status.diverged(self.network, x, now, message)
        block, stage = self.compiled.outside(x, self.guard)
        if block >= 0:
            return status.left_domain(self.network, block, stage, now)
        if why := self._time_is_up(x, now):
            return self._told(status.not_settled, why)
        return self._told(status.stalled, why) if (why := self._no_headway(now)) else None

    def _told(self, how: Callable[..., Status], why: str) -> Status:
        return how(self.recorder.residuals[-1], float(self.solver.t), why)

    def _no_headway(self, now: float) -> str | None:
        """Looked at once a window: whether the residual falls and the time goes on."""
        recorder, window = self.recorder, window_of(self.backend.most_steps)
        steps = recorder.steps
        if steps % CRAWL == 0 and now - recorder.residual_times[-1 - CRAWL] < self.fastest:
            moves = np.abs(self.rhs(self.solver.y))
            neuron = self.network.label(int(moves.argmax()))
            return f"its steps have become very short where neuron {neuron} moves fast"
        if steps % window or steps < 3 * window:
            return None
        worst = np.array(recorder.residuals[-2 * window :]).max(axis=1)
        if np.nanmin(worst[window:]) < HEADWAY * np.nanmin(worst[:window]):
            return None
        return f"the last {window} steps made it no smaller"

    def _time_is_up(self, x: np.ndarray, now: float) -> str | None:
        """Which bound ended the run; the fastest rate at the start may not be that of the rest."""
        if self.recorder.steps >= self.backend.most_steps:
            return f"{self.recorder.steps} integration steps were done (most_steps)"
        if self.solver.status == "running":
            return None
        end = self.backend.limit / self.compiled.fastest_rate(x)
        if end > now * (1 + 1e-9):
            self.solver.t_bound, self.solver.status = end, "running"
            return None
        return f"{self.backend.limit:g} fastest time constants had passed (limit)"
