"""Is there anything to be found? Asked where a run stalls, answered in as little time as it takes.

Whether the target can be met is shown once, by a path that meets it. Whether the cost has a minimum
is asked only where it takes large negative values, since a sum of squares has one.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ann_dc.optimality.boundedness import Unbounded, without_minimum
from ann_dc.optimality.feasibility import feasible_path
from ann_dc.optimality.feasibility_search import Path
from ann_dc.optimality.infeasibility import Infeasible, out_of_reach
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.problem.scales import natural_scales
from ann_dc.progress import Progress, Stopped, silent

SAMPLES = 2000
"""Points at which the cost is looked at."""
SIZES = (1.0, 1e2, 1e4)
"""Of states and controls there, in their scales."""
NEGATIVE = 1e3
"""Cost below zero, in its scale, from which on it may have no minimum."""


class Hopeless(Stopped):
    """A run was ended since there is nothing that it could find.

    Attributes
    ----------
    found : Infeasible or Unbounded
    """

    def __init__(self, found: Infeasible | Unbounded) -> None:
        super().__init__(found.message)
        self.found = found

    def __reduce__(self):
        return type(self), (self.found,)


@dataclass(kw_only=True, eq=False)
class Prospect:
    """What is known of a problem's prospects, looked at less and less often.

    Attributes
    ----------
    problem : OptimalControlProblem
    progress : Progress
        Takes a line an iteration.
    feasible : Path or None
        A path that meets the constraints, once one is known.
    asked : int
        How often it was asked.
    followed : bool
        Whether the cost has been followed downhill from that path.
    bottomless : Unbounded or None
        Where that led to, if to no minimum.
    """

    problem: OptimalControlProblem
    progress: Progress = silent
    feasible: Path | None = None
    asked: int = field(default=0, init=False)
    followed: bool = field(default=False, init=False)
    bottomless: Unbounded | None = field(default=None, init=False)

    def doubt(self, q: np.ndarray, u: np.ndarray) -> None:
        """Look at the first, second, fourth, ... time.

        Parameters
        ----------
        q : (n, N+1) array
            States with the end, in the user's units, where a run stalls.
        u : (m, N) array

        Raises
        ------
        Hopeless
            If the target cannot be met, or the cost has no minimum.
        """
        self.asked += 1
        if self.asked & (self.asked - 1) == 0 and (found := self.look(q, u)):
            raise Hopeless(found)

    def look(self, q: np.ndarray, u: np.ndarray) -> Infeasible | Unbounded | None:
        """What makes a problem hopeless, seen from a path; None where nothing was found.

        Parameters
        ----------
        q : (n, N+1) array
            States with the end, in the user's units; a path with values that are no numbers is
            left out.
        u : (m, N) array

        Examples
        --------
        A car that cannot steer:

        >>> import sympy as sp
        >>> from ann_dc.problem import OptimalControlProblem, straight_line
        >>> x, y, a = sp.symbols("x y a")
        >>> problem = OptimalControlProblem(
        ...     states=(x, y), controls=(a,), dynamics=(a, 0 * a), cost=a**2, horizon=5,
        ...     q_0=(0, 0), q_d=(1, 1))
        >>> line = straight_line(problem)
        >>> Prospect(problem=problem).look(line.q, line.u).reached
        {'q_d.y': ...}
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
        """Whether the cost takes large negative values somewhere."""
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
