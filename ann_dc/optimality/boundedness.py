"""Boundedness check: descent of the cost along feasible paths with growing steps.

Each step from a feasible path follows the cost gradient projected onto the tangent space of the
constraints; Gauss-Newton steps then restore feasibility. An unbounded problem is shown by an
example: paths that satisfy dynamics and target while the cost decreases without end and some state
or control grows. Inequalities and control limits remain satisfied: a step moves along those that it
would violate.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from ann_dc.optimality.feasibility_search import Path, Search
from ann_dc.optimality.soft_constraints import penalty
from ann_dc.problem.bounds import widths
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.problem.scales import natural_scales
from ann_dc.progress import Progress, silent

BOTTOMLESS = 1e10
"""Negative cost, in the scale of the cost, that no problem with a minimum reaches; times the
squared distance, in scales, to the farthest constraint or limit if that exceeds one.
"""
STEPS = 60
"""Largest number of descent steps: an unbounded cost is far below zero after 20."""
PUSHES = (1e-3, 1.0, 1.0, 10.0, 10.0, 100.0)
"""Random perturbations that leave a stationary point, relative to the gradient; saddles first."""
LAST_PUSHES = range(2, 15)
"""Powers of ten by which a control of the last stage is perturbed, in scales."""
GROWTH = 4.0
"""Factor on the step length after a success; divisor after a failure."""
SHORTEST = 1e-3
"""Step length, in scales, at which the descent ends."""
REGULAR = 1e-12
"""Regularisation of the normal matrix of the constraints, which may be dependent."""
RESTORED = 1e-6
"""Largest constraint violation after a step, relative to the largest state."""
ROUNDS = 5
"""Rounds in which constraints and limits violated by steepest descent are added."""
RESTORATIONS = 8
"""Gauss-Newton steps that restore feasibility."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Unbounded:
    """Unbounded cost, shown by a feasible path with that `objective` in the user's units.

    `largest` is the state or control that has grown most.
    """

    objective: float
    largest: str
    message: str


def without_minimum(
    problem: OptimalControlProblem, path: Path, progress: Progress = silent
) -> Unbounded | None:
    """Return a proof that the cost is unbounded, from a feasible path.

    Returns None if the descent converged or ran out of steps. Also returns None if the start is
    given and every control has limits on both sides: a continuous cost then has a minimum.
    `progress` receives one line per step.
    """
    if all(problem.fixed_start) and np.isfinite(problem.control_limits).all():
        return None
    with np.errstate(all="ignore"):
        return _Descent(problem, path, progress).run()


class _Descent:
    """Descent of the cost along feasible paths."""

    def __init__(self, problem: OptimalControlProblem, path: Path, progress: Progress) -> None:
        self.problem, self.path, self.progress = problem, path, progress
        self.search = Search(problem, progress=progress)
        self.scales = natural_scales(problem)
        self.rng = np.random.default_rng(0)
        self.cost = self._cost(path)
        self.bottom = -BOTTOMLESS * self.scales.cost * self._room() ** 2 - 10 * abs(self.cost)
        self.length = 1.0

    def run(self) -> Unbounded | None:
        if control := self._last_control():
            return self._reported(control)
        failures = 0
        for _ in range(STEPS):
            self.progress(f"boundedness: cost {self.cost:.3g} decreasing")
            direction = self._direction(PUSHES[failures])
            if direction is None:
                return None
            if self._step(direction):
                failures = 0
            else:
                failures, self.length = failures + 1, 1.0
            if failures == len(PUSHES):
                return None
            if self.cost < self.bottom:
                return self._reported(self._largest())
        return None

    def _last_control(self) -> str:
        """Return the control of the last stage along which the cost is unbounded, if any.

        Each control is perturbed alone, together with a free end: all other stages resist the long
        steps of the descent.
        """
        functions, start = self.problem.functions, self.path
        for control, size in enumerate(self.search.control.ravel()):
            for push in (-size, size):
                for power in LAST_PUSHES:
                    u, q = start.u.copy(), start.q.copy()
                    u[control, -1] += push * 10.0**power
                    q[:, -1] = functions.map(q[:, :-1], u)[:, -1]
                    low, high = self.problem.control_limits[control]
                    ahead = self.search.path(q, u)
                    is_met = low <= u[control, -1] <= high and ahead.met
                    cost = self._cost(ahead)
                    if not (is_met and cost < self.cost):
                        break
                    if cost < self.bottom:
                        self.path, self.cost = ahead, cost
                        return str(self.problem.controls[control])
        return ""

    def _room(self) -> float:
        """Return the distance to the farthest constraint or limit in scales, at least 1."""
        model = self.search.model(self.path)
        ways = np.abs(np.concatenate([model.distance, model.low, model.high]))
        return float(ways[np.isfinite(ways)].max(initial=1.0))

    def _cost(self, path: Path) -> float:
        cost = self.problem.functions.objective(path.q, path.u)
        cost += penalty(self.problem, path.q, path.u)
        return cost if np.isfinite(cost) else np.inf

    def _slope(self) -> np.ndarray:
        """Return the cost gradient in the free states and the controls, in scales."""
        functions, search, path = self.problem.functions, self.search, self.path
        of_q, of_u = functions.cost_gradient(path.q[:, :-1], path.u)
        of_q = np.column_stack([of_q, functions.terminal(path.q[:, -1])[1]]) * search.state
        of_u = of_u * search.control
        return np.concatenate([of_q.T[search.free.T], of_u.T.ravel()]) / self.scales.cost

    def _direction(self, push: float) -> np.ndarray | None:
        """Return the unit direction of steepest descent, perturbed by `push` at saddles."""
        J, slope = self.search.jacobian(self.path), self._slope()
        noise = self.rng.standard_normal(len(slope))
        push *= max(float(np.linalg.norm(slope)), 1.0)
        slope = slope + push * noise / np.linalg.norm(noise)
        model = self.search.model(self.path)
        touching = model.distance > -RESTORED * self.path.size
        counts, held = np.zeros_like(touching), np.zeros(len(slope), bool)
        direction = None
        for _ in range(ROUNDS):
            rows = [J, model.of_distance[counts]] if counts.any() else [J]
            direction = _projected(sparse.vstack(rows, format="csr"), held, slope)
            if direction is None:
                return None
            left = touching & (model.of_distance @ direction > 0) & ~counts
            out = np.where(direction < 0, model.low == 0, (model.high == 0) & (direction > 0))
            if not left.any() and not out.any():
                break
            counts, held = counts | left, held | out
        return direction

    def _step(self, direction: np.ndarray) -> bool:
        """Take the longest of a few steps that lowers the cost; return False if none does."""
        while self.length > SHORTEST:
            ahead = self.search.moved(self.path, self.length * direction)
            if np.isfinite(ahead.violation):
                ahead = self.search.least_violation(ahead.q, ahead.u, RESTORATIONS)
            cost = self._cost(ahead)
            if ahead.violation < RESTORED * ahead.size and cost < self.cost:
                self.path, self.cost = ahead, cost
                self.length *= GROWTH
                return True
            self.length /= GROWTH
        return False

    def _largest(self) -> str:
        """Return the name of the state or control without two bounds that has grown most."""
        problem, search = self.problem, self.search
        sizes = [
            *np.abs(self.path.q / search.state).max(axis=1),
            *np.abs(self.path.u / search.control).max(axis=1),
        ]
        names = [str(symbol) for symbol in (*problem.states, *problem.controls)]
        held = np.isfinite(widths(problem.bounds, (*problem.states, *problem.controls)))
        return names[int(np.argmax(np.where(held, 0.0, sizes)))]

    def _reported(self, largest: str) -> Unbounded:
        problem = self.problem
        unit = f" {problem.cost_unit}" if problem.cost_unit else ""
        message = (
            "the cost has no minimum: with the constraints met it fell to "
            f"{self.cost:.3g}{unit} while {largest} grew; add a cost for {largest}, or check "
            "the signs"
        )
        return Unbounded(objective=self.cost, largest=largest, message=message)


def _projected(J, held: np.ndarray, slope: np.ndarray) -> np.ndarray | None:
    """Return the unit steepest descent in the null space of J, `held` entries fixed."""
    if held.any():
        J, slope = J @ sparse.diags_array(np.where(held, 0.0, 1.0)), np.where(held, 0.0, slope)
    normal = J @ J.T
    normal = (normal + REGULAR * sparse.eye_array(*normal.shape)).tocsc()
    try:
        direction = J.T @ splu(normal).solve(J @ slope) - slope
    except RuntimeError:  # singular: some entry is no number
        return None
    size = float(np.linalg.norm(direction))
    return direction / size if 0 < size < np.inf else None
