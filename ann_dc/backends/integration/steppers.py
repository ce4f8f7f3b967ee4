"""Steppers of an integration: compiled code or a SciPy solver.

A stepper takes several steps at a time, returns them with their residuals, and stops if it cannot
continue.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple, TypeAlias, final
from weakref import WeakKeyDictionary

import numpy as np
from scipy import sparse

from ann_dc.backends.integration import integrator
from ann_dc.backends.integration.drawing import (
    PIECES,
    CompiledAgain,
    Pieces,
    SolvedAgain,
    take_step,
    within_limits,
)
from ann_dc.backends.integration.exits import CHECKS, located_exit
from ann_dc.backends.integration.limits import LimitedSolver
from ann_dc.backends.integration.methods import Between, Method
from ann_dc.backends.integration.systems import Cells, Integrand
from ann_dc.backends.integration.tableaus import Rows
from ann_dc.evaluation.codegen.evaluator import FastEvaluator
from ann_dc.evaluation.domains import DomainGuard
from ann_dc.evaluation.reference import evaluator
from ann_dc.network.network import Network

Steps: TypeAlias = tuple[np.ndarray, np.ndarray, np.ndarray]
"""Network times (steps,), (constraint, stationarity) residuals (steps, 2), states (steps, n)."""
RightHandSide: TypeAlias = Callable[[np.ndarray], np.ndarray]
"""Function that returns dx/ds (n,) of a state vector (n,)."""

DENSE_JACOBIAN = 400
"""Largest network whose Jacobian is passed to an implicit solver as a dense matrix."""
LOGGED = 200_000
"""Number of state values that compiled code records per call."""
ITERATIONS, CONVERGED = (20, 27), 1e-2
"""Numbers of power iterations of the fastest rate, and the change by which they have converged."""
FIRST_STEP = 0.05
"""First trial step in fastest time constants."""


class Beginning(NamedTuple):
    """Constant facts about a network at its start."""

    x: np.ndarray  # start (n,)
    guard: DomainGuard  # domains of the function blocks from the start on
    residuals: tuple[float, float]  # constraint and stationarity residuals
    fastest: float  # fastest time constant

    @classmethod
    def of(cls, network: Network, compiled: FastEvaluator) -> Beginning:
        """Return the facts of a network; they are computed once per network."""
        if network not in _starts:
            x = network.start_state
            guard, residuals = compiled.domain_guard(x), compiled.residuals(x)
            _starts[network] = cls(x, guard, residuals, 1 / compiled.fastest_rate(x))
        return _starts[network]


def fastest_rate(compiled: FastEvaluator, x: np.ndarray) -> float:
    """Return the spectral radius of d rhs / dx at a state (n,), in 1 / network time.

    Power iterations do not converge if the fastest modes oscillate; the rate is then taken from
    the eigenvalues of a network of up to `DENSE_JACOBIAN` neurons.
    """
    rate, later = (compiled.fastest_rate(x, count) for count in ITERATIONS)
    if abs(later - rate) <= CONVERGED * rate or len(x) > DENSE_JACOBIAN:
        return rate
    derivative, drives = compiled.clamped(~compiled.free(x)), compiled.drive_jacobian(x).toarray()
    flow = np.array([derivative(column) for column in np.ascontiguousarray(drives.T)])
    return float(np.abs(np.linalg.eigvals(flow)).max()) or rate


_starts: WeakKeyDictionary[Network, Beginning] = WeakKeyDictionary()


class Stepper(ABC):
    """Integration in progress.

    ``failed`` is the reason why no next step is possible, and ``beyond`` (n,) a state outside a
    domain to which every next step leads. ``exit`` is the time of the residual's last exit from
    above the tolerance, located inside its step; nan while the residual is above.
    """

    time: float
    state: np.ndarray
    failed: str | None = None
    beyond: np.ndarray | None = None
    at_end: bool = False
    evaluations: int = 0
    exit: float = float("nan")

    @property
    @abstractmethod
    def between(self) -> Between | None:
        """States between the steps so far; None if they are not known."""

    @abstractmethod
    def steps(self, most: int) -> Steps:
        """Take up to ``most`` more steps, at least one unless the stepper has failed."""

    @abstractmethod
    def go_on(self, until: float) -> None:
        """Move the end of the integration to a later time."""


@final
class CompiledStepper(Stepper):
    """Stepper in compiled code with many steps per call: see `integrator.advance`."""

    def __init__(
        self,
        integrand: Integrand,
        rows: Rows,
        start: np.ndarray,
        first: float,
        ends: integrator.Ends,
        between: Between,
    ) -> None:
        self.rows, self.ends, self._between = rows, ends, between
        self.integrand = integrand  # whose memory generated code knows by address
        self.system, self._chosen = integrand.system, integrand.chosen
        x = integrand.state(start)
        self.course = integrator.Course.at(x, integrand.length, self.rows, first)
        self.time, self.state = 0.0, start

    @property
    def between(self) -> Between:
        """Function that integrates every gap again."""
        return self._between

    def steps(self, most: int) -> Steps:
        """Take the requested number of steps, or as many as the log has room for."""
        size, first = self.system.size, self.system.ghost
        log = integrator.Log.of(min(most, max(LOGGED // max(size, 1), 1)), size)
        count, ended = integrator.advance(self.system, self.rows, self.course, self.ends, log)
        self.at_end = ended == integrator.TIME_UP
        if ended == integrator.TOO_SHORT:
            self.failed = "the step became shorter than the floating-point resolution of the time"
        if ended == integrator.LEFT_DOMAIN:
            self.beyond = self.course.ahead[first : first + size][self._chosen]
        self.time, self.evaluations = float(self.course.clock[0]), int(self.course.clock[3])
        self.exit = float(self.course.clock[6])
        self.state = self.course.x[first : first + size][self._chosen]
        return log.times[:count], log.residuals[:count], log.states[:count][:, self._chosen]

    def go_on(self, until: float) -> None:
        """Move the end of the integration to a later time."""
        self.ends, self.at_end = self.ends._replace(until=until), False


@final
class SciPyStepper(Stepper):
    """Stepper with one step per call, by a factory of a solver with SciPy's interface.

    The last exit of a residual from the ``tolerance`` is located.
    """

    def __init__(
        self,
        compiled: FastEvaluator,
        rhs: RightHandSide,
        method: Method,
        solver: Callable[[Callable], Any],
        tolerance: float,
    ) -> None:
        self.compiled, self.rhs, self.method = compiled, rhs, method
        self.solver: Any = solver(self._counted)
        self.time, self.state = float(self.solver.t), self.solver.y
        self.tolerance, self._worst = tolerance, max(compiled.residuals(self.state))
        self.exit = 0.0 if self._worst < tolerance else float("nan")
        self._pieces: list[Any] | None = [] if method.implicit else None

    @property
    def between(self) -> Between | None:
        """Polynomials of an implicit solver; gaps integrated again for an explicit one."""
        if self._pieces is not None:
            return Pieces(pieces=self._pieces, compiled=self.compiled)
        if self.method.implicit:
            return None
        return SolvedAgain(method=self.method, rhs=self.rhs, compiled=self.compiled)

    def _keep_piece(self) -> None:
        if self._pieces is None:
            return
        self._pieces.append(self.solver.dense_output())
        if 4 * len(self._pieces) * self.state.size > PIECES:
            self._pieces = None

    def _watch(self, began: float, worst: float) -> None:
        """Update the time since which the residual stays below the tolerance."""
        before, self._worst = self._worst, worst
        if not worst < self.tolerance:
            self.exit = float("nan")
        elif not max(before, worst) < integrator.SWING * self.tolerance:
            inside, grid = self.solver.dense_output(), np.linspace(began, self.time, CHECKS + 1)
            exit = located_exit(
                lambda times: self._worst_at(within_limits(self.compiled, inside(times).T)),
                grid,
                self.tolerance,
            )
            self.exit = self.exit if exit is None else exit

    def _worst_at(self, states: np.ndarray) -> np.ndarray:
        return np.array([max(self.compiled.residuals(x)) for x in states])

    def _counted(self, _, x: np.ndarray) -> np.ndarray:
        self.evaluations += 1
        return self.rhs(x)

    def steps(self, most: int) -> Steps:
        """Take one step; return no row if it fails."""
        began, message = self.time, take_step(self.solver, self.method, self.compiled, self._worst)
        if self.solver.status == "failed":
            self.failed = message or "the integration method failed"
            return np.empty(0), np.empty((0, 2)), np.empty((0, self.state.size))
        self._keep_piece()
        self.time, self.state = float(self.solver.t), within_limits(self.compiled, self.solver.y)
        residuals = self.compiled.residuals(self.state)
        self._watch(began, max(residuals))
        self.at_end = self.solver.status == "finished"
        return np.array([self.time]), np.array([residuals]), np.array([self.state])

    def go_on(self, until: float) -> None:
        """Move the end of the integration to a later time."""
        self.solver.t_bound, self.solver.status, self.at_end = until, "running", False


def stepper_of(
    compiled: FastEvaluator,
    method: Method,
    rhs: RightHandSide | None,
    ends: integrator.Ends,
    *,
    cells: Cells,
    guard: DomainGuard,
    first: float,
) -> Stepper:
    """Return a stepper that begins at a network's start, with a ``first`` step in compiled code.

    Compiled code supports only the network's right-hand side, which alone has a Jacobian. For
    another right-hand side, SciPy's method of the same kind is used.
    """
    network = compiled.network
    start = network.start_state
    if method.rows is not None:
        if rhs is None:
            integrand = cells.integrand(compiled, guard)
            between = CompiledAgain(network=network, method=method, cells=cells)
            return CompiledStepper(integrand, method.rows, start, first, ends, between)
        method = replace(method, solver="DOP853")
    options: dict[str, Any] = {"rtol": method.rtol, "atol": method.atol}
    solver = method.scipys
    solve = lambda counted: solver(counted, 0.0, start, ends.until, **options)  # noqa: E731
    if method.implicit and rhs is None:
        solve = lambda counted: limited(compiled, method, counted, start, ends.until)  # noqa: E731
    return SciPyStepper(compiled, rhs or compiled.rhs, method, solve, ends.tolerance)


def limited(
    compiled: FastEvaluator,
    method: Method,
    rhs: Callable,
    start: np.ndarray,
    until: float,
    clock: Callable[[float], None] | None = None,
) -> LimitedSolver:
    """Return an implicit SciPy solver from a state (n,); the ``clock`` sets inputs to a time."""
    scipys, tolerances = method.scipys, {"rtol": method.rtol, "atol": method.atol}

    def solver(slope: Callable, jac: Callable, time: float, x: np.ndarray, end: float) -> Any:
        return scipys(slope, time, x, end, jac=jac, **tolerances)

    jacobian = partial(_jacobian, compiled, method, clock or (lambda _: None))
    return LimitedSolver(compiled, solver, rhs, jacobian, start, until)


def _jacobian(
    compiled: FastEvaluator, method: Method, clock: Callable[[float], None], held: np.ndarray
) -> Callable[[float, np.ndarray], Any]:
    """Return d rhs / dx as a function of time and state for saturated neurons (n,)."""
    network, preconditioner = compiled.network, evaluator(compiled.network).preconditioner
    if (held & network.preconditioner.reach(network.layout)[network.places[:, 0]]).any():
        preconditioner = sparse.csr_array(
            network.preconditioner.among(network.layout, held)(np.eye(len(held)))
        )

    def by_state(time: float, x: np.ndarray) -> Any:
        clock(time)
        jacobian = preconditioner @ compiled.drive_jacobian(x)
        if network.size <= DENSE_JACOBIAN or method.name == "LSODA":
            return jacobian.toarray()
        return sparse.csc_matrix(jacobian)

    return by_state
