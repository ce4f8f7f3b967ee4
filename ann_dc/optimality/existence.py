"""Feasibility and boundedness checks of a problem whose run stalls.

Feasibility of the target is shown once, by a path that reaches it. Boundedness is checked only if
the cost takes large negative values, since a sum of squares has a minimum.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ann_dc.optimality.boundedness import Unbounded, without_minimum
from ann_dc.optimality.feasibility import Infeasible, feasible_path, out_of_reach
from ann_dc.optimality.feasibility_search import Path
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.problem.scales import natural_scales
from ann_dc.progress import Progress, Stopped, silent

SAMPLES = 2000
"""Number of points at which the cost is sampled."""
SIZES = (1.0, 1e2, 1e4)
"""Amplitudes of states and controls at these points, in their scales."""
NEGATIVE = 1e3
"""Negative cost, in its scale, beyond which the cost may be unbounded."""


class Hopeless(Stopped):
    """Raised to end a run of an infeasible or unbounded problem; `found` is the proof."""

    def __init__(self, found: Infeasible | Unbounded) -> None:
        super().__init__(found.message)
        self.found = found

    def __reduce__(self):
        return type(self), (self.found,)


@dataclass(kw_only=True, eq=False)
class Prospect:
    """Feasibility and boundedness of a problem, checked at increasing intervals.

    `feasible` is a feasible path, once known. `followed` is True once the boundedness check from
    that path is done, and `bottomless` is its result.
    """

    problem: OptimalControlProblem
    progress: Progress = silent
    feasible: Path | None = None
    asked: int = field(default=0, init=False)
    followed: bool = field(default=False, init=False)
    bottomless: Unbounded | None = field(default=None, init=False)

    def doubt(self, q: np.ndarray, u: np.ndarray) -> None:
        """Check a stalled run, q (n, N+1) and u (m, N), at the first, second, fourth, ... request.

        Raises `Hopeless` if the target is infeasible or the cost is unbounded.
        """
        self.asked += 1
        if self.asked & (self.asked - 1) == 0 and (found := self.look(q, u)):
            raise Hopeless(found)

    def look(self, q: np.ndarray, u: np.ndarray) -> Infeasible | Unbounded | None:
        """Return the infeasibility or unboundedness found from q (n, N+1) and u (m, N), or None.

        A path with non-finite values is ignored.
        """
        if self.feasible is None:
            path = feasible_path(self.problem, q, u, self.progress)
            if not path.met:
                return out_of_reach(self.problem, path, self.progress)
            self.feasible = path
        if not self.followed:
            self.followed = True
            if self._dips:
                self.bottomless = without_minimum(self.problem, self.feasible, self.progress)
        return self.bottomless

    @property
    def _dips(self) -> bool:
        """True if the cost takes large negative values at some sample."""
        problem, scales = self.problem, natural_scales(self.problem)
        if problem.objectives:  # one that falls is not the largest
            return False
        rng, stages = np.random.default_rng(0), problem.horizon
        lowest = 0.0
        with np.errstate(all="ignore"):
            for number in range(max(SAMPLES // stages, 1)):
                size = SIZES[number % len(SIZES)]
                q = size * rng.standard_normal((problem.n, stages + 1))
                u = size * rng.standard_normal((problem.m, stages))
                q = np.array([s.user(row) for s, row in zip(scales.states, q)])
                u = np.array([s.user(row) for s, row in zip(scales.controls, u)])
                u = np.clip(u, *problem.control_limits.T[:, :, None])
                costs = [*problem.functions.cost(q[:, :-1], u)]
                costs += [problem.functions.terminal(q[:, -1])[0]]
                lowest = min(lowest, np.nanmin(np.nan_to_num(costs, nan=0.0)))
        return bool(lowest < -NEGATIVE * scales.cost)
