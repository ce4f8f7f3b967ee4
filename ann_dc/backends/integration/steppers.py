"""Who takes the steps of an integration: compiled code by itself, or one of SciPy's solvers.

A stepper is where the integration is (time, state) and takes some steps at a time. It tells every
one of them with its residuals, and stops by itself where it cannot go on.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple, TypeAlias, final
from weakref import WeakKeyDictionary

import numpy as np
from scipy import sparse

from ann_dc.backends.integration import integrator
from ann_dc.backends.integration.cells import Cells
from ann_dc.backends.integration.methods import Method
from ann_dc.backends.integration.systems import Integrand
from ann_dc.backends.integration.tableaus import Rows
from ann_dc.evaluation.domains import DomainGuard
from ann_dc.evaluation.generated.choice import FastEvaluator
from ann_dc.evaluation.reference import evaluator
from ann_dc.network.network import Network

Steps: TypeAlias = tuple[np.ndarray, np.ndarray, tuple[np.ndarray, np.ndarray]]
"""Network times (steps,), (constraint, stationarity) residuals (steps, 2), and the curve: times
(c,) and states (c, n)."""
RightHandSide: TypeAlias = Callable[[np.ndarray], np.ndarray]
"""dx/ds (n,) of a state vector (n,)."""

DENSE_JACOBIAN = 400
"""Largest network whose Jacobian is handed to an implicit solver as a dense matrix."""
LOGGED = 200_000
"""Numbers of states that compiled code takes down before it hands over."""
POINTS = 2
"""Of the curve of a step, which may be long."""
LARGEST_CURVE = 40_000
"""Numbers of all points of a step beyond which only its end is kept."""
FIRST_STEP = 0.05
"""First step to try, in fastest time constants."""


class Beginning(NamedTuple):
    """What is known of a network where it starts; nothing of it ever changes."""

    x: np.ndarray
    """(n,): the start."""
    guard: DomainGuard
    """Domains of the function blocks, from there on."""
    residuals: tuple[float, float]
    """Constraint and stationarity residuals."""
    fastest: float
    """Fastest time constant."""

    @classmethod
    def of(cls, network: Network, compiled: FastEvaluator) -> Beginning:
        """Worked out once a network."""
        if network not in _starts:
            x = network.start_state
            guard, residuals = compiled.domain_guard(x), compiled.residuals(x)
            _starts[network] = cls(x, guard, residuals, 1 / compiled.fastest_rate(x))
        return _starts[network]


_starts: WeakKeyDictionary[Network, Beginning] = WeakKeyDictionary()


class Stepper(ABC):
    """An integration under way.

    Attributes
    ----------
    time : float
        Network time.
    state : (n,) array
        As it is then.
    failed : str or None
        Why there is no next step, in words.
    beyond : (n,) array or None
        A state outside the domain of a function block, into which every next step leads.
    at_end : bool
        Whether the time that was asked for has passed.
    evaluations : int
        Right-hand sides so far.
    """

    time: float
    state: np.ndarray
    failed: str | None = None
    beyond: np.ndarray | None = None
    at_end: bool = False
    evaluations: int = 0

    @abstractmethod
    def steps(self, most: int) -> Steps:
        """Up to ``most`` more steps, one at least where it has not failed."""

    @abstractmethod
    def go_on(self, until: float) -> None:
        """The end is later than was said."""


@final
class CompiledStepper(Stepper):
    """Many steps a call, in compiled code: see `integrator.advance`.

    Parameters
    ----------
    integrand : Integrand
    rows : Rows
    start : (n,) array
    first : float
        First step to try.
    ends : integrator.Ends
    """

    def __init__(
        self,
        integrand: Integrand,
        rows: Rows,
        start: np.ndarray,
        first: float,
        ends: integrator.Ends,
    ) -> None:
        self.rows, self.ends = rows, ends
        self.integrand = integrand  # whose memory generated code knows by address
        self.system, self._chosen = integrand.system, integrand.chosen
        x = integrand.state(start)
        self.course = integrator.Course.at(x, integrand.length, self.rows, first)
        self.time, self.state = 0.0, start

    def steps(self, most: int) -> Steps:
        """As many as are asked for, or as the log has room for."""
        size, first = self.system.size, self.system.ghost
        points = POINTS if size * POINTS < LARGEST_CURVE else 1
        room = max(LOGGED // (points * max(size, 1)), 1)
        log = integrator.Log.of(min(most, room), size, points)
        count, ended = integrator.advance(self.system, self.rows, self.course, self.ends, log)
        self.at_end = ended == integrator.TIME_UP
        if ended == integrator.TOO_SHORT:
            self.failed = "the step became shorter than floating point can add to the time"
        if ended == integrator.OUTSIDE:
            self.beyond = self.course.ahead[first : first + size][self._chosen]
        self.time, self.evaluations = float(self.course.clock[0]), int(self.course.clock[3])
        self.state = self.course.x[first : first + size][self._chosen]
        curve = log.curve[:count].reshape(count * points, size)[:, self._chosen]
        return log.times[:count], log.residuals[:count], (log.curve_times[:count].ravel(), curve)

    def go_on(self, until: float) -> None:
        """The end is later than was said."""
        self.ends, self.at_end = self.ends._replace(until=until), False


@final
class SciPyStepper(Stepper):
    """One step a call, by a solver with SciPy's interface.

    The tolerance of an explicit one shrinks with the residual, as in `integrator.advance`.

    Parameters
    ----------
    compiled : FastEvaluator
        Says what the residuals are.
    rhs : callable
    solver : callable
        Makes the `scipy.integrate.OdeSolver`, from its right-hand side.
    shrinks : bool
        Whether the solver is explicit.
    """

    def __init__(
        self,
        compiled: FastEvaluator,
        rhs: RightHandSide,
        solver: Callable[[Callable], Any],
        *,
        shrinks: bool,
    ) -> None:
        self.compiled, self.rhs, self.shrinks = compiled, rhs, shrinks
        self.solver: Any = solver(self._counted)
        self.rtol, self.atol = getattr(self.solver, "rtol", 0.0), getattr(self.solver, "atol", 0.0)
        self.time, self.state = float(self.solver.t), self.solver.y

    def _keep_within_rails(self) -> None:
        """Where the solver is one that begins a step with a state and its slope alone."""
        low, high = self.compiled.tape.limits[self.compiled.tape.places[:, 0]].T
        within = np.clip(self.solver.y, low, high)
        if hasattr(self.solver, "f") and not np.array_equal(within, self.solver.y):
            self.solver.y, self.solver.f = within, self._counted(0.0, within)

    def _counted(self, _, x: np.ndarray) -> np.ndarray:
        self.evaluations += 1
        return self.rhs(x)

    def steps(self, most: int) -> Steps:
        """One."""
        message = self.solver.step()
        self._keep_within_rails()
        self.time, self.state = float(self.solver.t), self.solver.y
        residuals = self.compiled.residuals(self.state)
        if self.shrinks and self.rtol:
            share = integrator.share_of_tolerance(max(residuals), self.rtol)
            self.solver.rtol, self.solver.atol = self.rtol * share, self.atol * share
        if self.solver.status == "failed":
            self.failed = message or "the method failed"
        self.at_end = self.solver.status == "finished"
        times = np.array([self.time])
        return times, np.array([residuals]), (times, np.array([self.state]))

    def go_on(self, until: float) -> None:
        """The end is later than was said."""
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
    """An integration from a network's start.

    Compiled code calls no right-hand side but the network's own: for another, SciPy's method of the
    same kind does.

    Parameters
    ----------
    compiled : FastEvaluator
        Of the network.
    method : Method
    rhs : RightHandSide, optional
        By default the network's own, which alone comes with its Jacobian.
    ends : integrator.Ends
    cells : Cells
        How cells are evaluated in compiled code.
    guard : DomainGuard
        Domains of the function blocks, from the start on.
    first : float
        First step to try, in compiled code.

    Returns
    -------
    Stepper
    """
    network = compiled.network
    start = network.start_state
    if method.rows is not None:
        if rhs is None:
            integrand = cells.integrand(compiled, guard)
            return CompiledStepper(integrand, method.rows, start, first, ends)
        method = replace(method, solver="DOP853")
    options: dict[str, Any] = {"rtol": method.rtol, "atol": method.atol}
    if method.implicit and rhs is None:
        options["jac"] = lambda _, x: _jacobian(compiled, x, method)
    solver = method.scipys
    return SciPyStepper(
        compiled,
        rhs or compiled.rhs,
        lambda counted: solver(counted, 0.0, start, ends.until, **options),
        shrinks=not method.implicit,
    )


def _jacobian(compiled: FastEvaluator, x: np.ndarray, method: Method) -> Any:
    network = compiled.network
    jacobian = evaluator(network).metric @ compiled.drive_jacobian(x)
    if network.size <= DENSE_JACOBIAN or method.name == "LSODA":
        return jacobian.toarray()
    return sparse.csc_matrix(jacobian)
