"""Local optimum of a problem by a primal-dual interior-point method.

Newton steps solve barrier problems (`barrier`) with decreasing parameter t; the linear algebra
proceeds by stages. A multiple of the identity is added to the Hessian until the test by stages
finds the Hessian positive definite on the null space of the constraints. A filter accepts step
lengths. If it accepts none, Gauss-Newton steps reduce the infeasibility, and the next shift of the
Hessian is larger.

References
----------
.. [1] A. Wächter, L. T. Biegler, On the implementation of an interior-point filter line-search
   algorithm for large-scale nonlinear programming, Mathematical Programming 106 (2006).
.. [2] C. V. Rao, S. J. Wright, J. B. Rawlings, Application of interior-point methods to model
   predictive control, J. Optimization Theory and Applications 99 (1998).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ann_dc.optimality.barrier import Barrier, Caution, Model, Point
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.problem.scales import straight_line
from ann_dc.progress import Progress, silent

TOLERANCE = 1e-11
"""Scaled error of a converged point. A point with weakly active constraints is off by its root."""
ACCEPTABLE = 1e-8
"""Scaled error of a converged point if rounding prevents further steps."""
BARRIER = 0.1
"""Initial barrier parameter t."""
ITERATIONS = 400
CENTRALITY = 10.0
"""Error of a barrier problem over t below which t decreases."""
TO_BOUNDARY = 0.99
"""Smallest fraction of the distance to the boundary that a step may cover."""
FIRST_SHIFT, SMALLEST_SHIFT, LARGEST_SHIFT = 1e-4, 1e-8, 1e8
FORCED_SHIFT, LARGEST_FORCED = 1e-2, 1e8
"""Shift after a failed line search, and the largest shift."""
MARGIN = 1e-5
"""Decrease that the filter requires, relative to the infeasibility."""
ARMIJO = 1e-4
NEARLY_FEASIBLE = 1e-2
"""Infeasibility below which a step may decrease the barrier function alone."""
RESTORATIONS = 60
"""Largest number of restorations of one search."""
NUDGES = 3
"""Largest number of saddle points that one search leaves."""
NUDGE = 0.01
"""Distance of the restart point from a saddle point, in scales."""
APPROACHES = 40
"""Largest number of Gauss-Newton steps of one restoration."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Extremum:
    """Result of a search in the user's units; if not `converged`, `reason` explains the end.

    The objective includes the cost of soft constraints. States (n, N+1) include the end; controls
    are (m, N), multipliers mu (n, N), zeta (r, N) and zeta_end (r_e,).
    """

    converged: bool
    reason: str
    iterations: int
    objective: float
    q: np.ndarray
    u: np.ndarray
    mu: np.ndarray
    zeta: np.ndarray
    zeta_end: np.ndarray


def interior_point(
    problem: OptimalControlProblem,
    q: np.ndarray | None = None,
    u: np.ndarray | None = None,
    *,
    caution: Caution = Caution.NONE,
    restorations: int = RESTORATIONS,
    progress: Progress = silent,
) -> Extremum:
    """Search for a local optimum from a path; check ``converged`` of the result.

    Method of [1]_ with the elimination by stages of [2]_. The initial guess q (n, N+1), u (m, N) is
    in the user's units, by default the straight line. `caution` reduces the natural scales, which
    can be far too large for states that move without control. `restorations` take most of the time
    of a failing search. Problems with several objectives are not supported.
    """
    line = straight_line(problem)
    q, u = line.q if q is None else q, line.u if u is None else u
    return _Search(Barrier.of(problem, q, u, caution), q, u, progress, restorations).run()


class _Search:
    """State of a search: the model at its point, t, the filter and the shifts."""

    def __init__(self, barrier: Barrier, q, u, progress, restorations) -> None:
        self.barrier, self.progress = barrier, progress
        self.t = BARRIER
        mu = np.zeros((barrier.problem.n, barrier.problem.horizon))
        self.model = Model(self.barrier, self.barrier.start(q, u, mu, self.t))
        self.filter: list[tuple[float, float]] = []
        self.shift = self.forced = 0.0
        self.restorations = self.nudges = 0
        self.most = restorations
        self.closest, self.smallest = self.model, ACCEPTABLE

    def run(self) -> Extremum:
        """Take Newton steps until the error is small, or until no step is possible."""
        for iteration in range(ITERATIONS):
            if not self.model.is_finite:
                return self.result("the problem has no finite value at the start", iteration)
            self.note()
            if self.smallest < TOLERANCE:
                if self.nudges == NUDGES or self.model.step(self.t, 0.0) is not None:
                    return self.result("converged", iteration)
                self.nudge()
            self.decrease()
            if failure := self.advance():
                return self.ended(failure, iteration)
            self.progress(
                f"interior point: iteration {iteration + 1}, t = {self.t:.0e}, "
                f"infeasibility {self.model.infeasibility:.1e}"
            )
        return self.ended(f"not converged in {ITERATIONS} iterations", ITERATIONS)

    def note(self) -> None:
        """Store the point if its error is the smallest so far."""
        if (error := self.model.error(0.0)) < self.smallest:
            self.closest, self.smallest = self.model, error

    def ended(self, failure: str, iteration: int) -> Extremum:
        """Return the result if no step is possible; use the best point if acceptable."""
        if self.smallest < ACCEPTABLE:
            self.model, failure = self.closest, "converged"
        return self.result(failure, iteration)

    def advance(self) -> str:
        """Take a step, or return the reason for its failure."""
        step = self.step()
        if step is None:
            return "" if self.restored() else "no shift of the Hessian gives a step"
        if self.accepted(step) or self.recovered():
            return ""
        return "no step length was accepted"

    def decrease(self) -> None:
        """Decrease t while the error of its barrier problem is small enough."""
        least = TOLERANCE / 10
        while self.t > least and self.model.error(self.t) < CENTRALITY * self.t:
            self.t = max(least, min(0.2 * self.t, self.t**1.5))
            self.filter.clear()

    def nudge(self) -> None:
        """Restart near a saddle point, with its multipliers of the dynamics."""
        rng, point, barrier = np.random.default_rng(self.nudges), self.model.point, self.barrier
        self.nudges, self.t = self.nudges + 1, BARRIER * NUDGE
        beside = (value + NUDGE * rng.standard_normal(value.shape) for value in (point.q, point.u))
        q, u = barrier.users(*beside)
        mu = (point.mu * barrier.frame.cost / barrier.frame.state).T
        self.model = Model(barrier, barrier.start(q, u, mu, self.t))
        self.closest, self.smallest = self.model, ACCEPTABLE
        self.filter.clear()

    def step(self) -> Point | None:
        """Return a Newton step with the smallest tested shift that gives descent.

        Rounding can make the test by stages fail for every shift if constraints are nearly
        dependent. The curvature along the step then decides.
        """
        for is_counted in (True, False):
            shift = 0.0
            while shift < LARGEST_SHIFT:
                step = self.model.step(self.t, max(shift, self.forced), is_counted=is_counted)
                if step is not None:
                    self.shift = shift or self.shift
                    return step
                first = max(SMALLEST_SHIFT, self.shift / 3) if self.shift else FIRST_SHIFT
                shift = shift * (8.0 if self.shift else 100.0) if shift else first
        return None

    def accepted(self, step: Point) -> bool:
        """Take the longest halved step that the filter accepts; return False if none is."""
        model, t = self.model, self.t
        longest, dual = model.longest(step, max(TO_BOUNDARY, 1.0 - t))
        value, infeasibility = model.value(t), model.infeasibility
        slope, length = model.descent(step, t), longest
        least = 1e-4 * longest if infeasibility > 1e-6 else 1e-10
        while length > least:
            trial = Model(self.barrier, model.point.moved(step, length, dual))
            if trial.is_finite and self.passes(trial):
                descends = slope < 0 and length * (-slope) ** 2.3 > infeasibility**1.1
                if descends and infeasibility <= NEARLY_FEASIBLE:
                    rounding = 1e-12 * abs(value)
                    if trial.value(t) <= value + ARMIJO * length * slope + rounding:
                        return self.adopted(trial)
                elif (
                    trial.infeasibility <= (1 - MARGIN) * infeasibility + 1e-14
                    or trial.value(t) <= value - MARGIN * infeasibility
                ):
                    self.remember()
                    return self.adopted(trial)
            length /= 2
        return False

    def adopted(self, trial: Model) -> bool:
        """Make a trial the model, with multipliers near t over the slacks; return True."""
        point = trial.centred(trial.point, self.t)
        self.model = Model(self.barrier, point)
        self.forced = self.forced / 10 if self.forced > 1e-3 else 0.0
        return True

    def passes(self, trial: Model) -> bool:
        """Return True if no entry of the filter dominates the trial."""
        value, infeasibility = trial.value(self.t), trial.infeasibility
        return not any(value >= v and infeasibility >= i for v, i in self.filter)

    def remember(self) -> None:
        """Add the point to the filter."""
        infeasibility = self.model.infeasibility
        value = self.model.value(self.t) - MARGIN * infeasibility
        self.filter.append((value, (1 - MARGIN) * infeasibility))

    def recovered(self) -> bool:
        """Restore feasibility or increase the Hessian shift after a failed line search."""
        if self.model.infeasibility > 1e-8:
            self.remember()
            if self.restored():
                self.forced = 0.0
                return True
        self.forced = max(10 * self.forced, FORCED_SHIFT, 0.0 if self.forced else self.shift)
        self.filter.clear()
        return self.forced <= LARGEST_FORCED

    def restored(self) -> bool:
        """Halve the infeasibility by Gauss-Newton steps; return False if that fails."""
        self.restorations += 1
        model, first = self.model, self.model.infeasibility
        for _ in range(APPROACHES if self.restorations < self.most else 0):
            step = model.approach()
            if step is None:
                break
            length, before = model.longest(step, 0.95)[0], model.infeasibility
            trial = model
            while length > 1e-8:
                trial = Model(self.barrier, model.point.moved(step, length, 0.0))
                if trial.infeasibility < (1 - 1e-3 * length) * before:
                    break
                length /= 2
            else:
                break
            model = trial
            if model.infeasibility < 0.5 * first and self.passes(model):
                fresh = model.point._replace(mu=np.zeros_like(model.point.mu))
                self.model = Model(self.barrier, fresh)
                return True
        return False

    def result(self, reason: str, iterations: int) -> Extremum:
        """Return the result in the user's units, active controls exactly at their limits."""
        barrier, point = self.barrier, self.model.point
        problem, units = barrier.problem, barrier.units
        q, u = barrier.users(point.q, point.u)
        pull = point.z[:, : len(units)] * units * barrier.frame.cost
        active = (point.z > point.s)[:-1, len(units) :].T
        limits = problem.control_limits
        for stages, (control, side) in zip(active, np.argwhere(np.isfinite(limits))):
            u[control, stages] = limits[control, side]
        low, high = limits.T
        return Extremum(
            converged=reason == "converged",
            reason=reason,
            iterations=iterations,
            objective=self.model.cost * barrier.frame.cost,
            q=q,
            u=np.clip(u, low[:, None], high[:, None]),
            mu=(point.mu * barrier.frame.cost / barrier.frame.state).T,
            zeta=pull[:-1, : len(problem.inequalities)].T,
            zeta_end=pull[-1, : len(problem.end_inequalities)],
        )
