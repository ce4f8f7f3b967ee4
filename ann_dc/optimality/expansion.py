r"""A problem around a point, to second order and in its own scales: what a certificate looks at.

With every state, control and the cost in `natural_scales`, a stage is

.. math::
    \delta q_{k+1} = F_k \delta q_k + B_k \delta u_k, \qquad
    \tfrac12 \delta z_k^T W_k \delta z_k + g_k^T \delta z_k, \qquad z_k = (q_k, u_k),

with g the slope of the cost and W the Hessian of l + mu' f. All of it comes from one evaluation of
the problem's own derivatives.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.problem.scales import natural_scales


class _Frame(NamedTuple):
    """What every expansion of a problem has in common."""

    fixed_start: np.ndarray
    fixed: np.ndarray
    ends: tuple[np.ndarray, np.ndarray]
    state: np.ndarray
    control: np.ndarray
    zero: np.ndarray
    cost: float
    of_jacobian: np.ndarray
    of_hessian: np.ndarray
    of_slope: np.ndarray

    @classmethod
    @lru_cache(maxsize=64)
    def of(cls, problem: OptimalControlProblem) -> _Frame:
        scales = natural_scales(problem)
        factors, offsets = np.array(scales.states + scales.controls).T
        state = factors[: problem.n]
        return cls(
            fixed_start=np.array(problem.fixed_start),
            fixed=np.array(problem.fixed),
            ends=problem.ends,
            state=state,
            control=factors[problem.n :],
            zero=offsets,
            cost=scales.cost,
            of_jacobian=factors / state[:, None],
            of_hessian=factors[:, None] * factors / scales.cost,
            of_slope=factors / scales.cost,
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Expansion:
    """The linear-quadratic problem around a point; stages are the first axis.

    Attributes
    ----------
    fixed_start, fixed : (n,) arrays of bool
        Which components q_0 and q_d fix.
    ends : two (n,) arrays
        q_0 and q_d in the user's units, a free component at its other end.
    state, cost : (n,) array and float
        One in these scales, in the user's units.
    q : (N+1, n) array
        States with the end.
    u : (N, m) array
    jacobian : (N, n, n+m) array
        (F_k, B_k).
    hessian : (N, n+m, n+m) array
        W_k.
    slope : (N, n+m) array
        g_k.
    end_hessian, end_slope : (n, n) and (n,) arrays
        Of the terminal cost.
    mu : (N, n) array
        Multipliers of the map.
    map : (n, N) array
        f(q_k, u_k), in the user's units.
    objective : float
        E, in the user's units.
    """

    fixed_start: np.ndarray
    fixed: np.ndarray
    ends: tuple[np.ndarray, np.ndarray]
    state: np.ndarray
    cost: float
    q: np.ndarray
    u: np.ndarray
    jacobian: np.ndarray
    hessian: np.ndarray
    slope: np.ndarray
    end_hessian: np.ndarray
    end_slope: np.ndarray
    mu: np.ndarray
    map: np.ndarray
    objective: float

    @classmethod
    def at(
        cls, problem: OptimalControlProblem, q: np.ndarray, u: np.ndarray, mu: np.ndarray
    ) -> Expansion:
        """The expansion of a problem.

        Parameters
        ----------
        problem : OptimalControlProblem
        q : (n, N+1) array
            States with the end, in the user's units.
        u : (m, N) array
        mu : (n, N) array
        """
        frame, n = _Frame.of(problem), len(q)
        of_state = frame.of_slope[:n]
        with np.errstate(all="ignore"):
            told = problem.functions.derivatives(q[:, :-1], u, mu)
            end, end_slope, end_hessian = problem.functions.terminal(q[:, -1])
            return cls(
                fixed_start=frame.fixed_start,
                fixed=frame.fixed,
                ends=frame.ends,
                state=frame.state,
                cost=frame.cost,
                q=(q.T - frame.zero[:n]) / frame.state,
                u=(u.T - frame.zero[n:]) / frame.control,
                jacobian=_by_stage(told.jacobian, frame.of_jacobian),
                hessian=_by_stage(told.hessian, frame.of_hessian),
                slope=told.gradient.T * frame.of_slope,
                end_hessian=end_hessian * frame.of_hessian[:n, :n],
                end_slope=end_slope * of_state,
                mu=mu.T * of_state,
                map=told.map,
                objective=float(told.cost.sum() + end),
            )

    def own_slope(self) -> np.ndarray:
        """(N, n+m) array: dl/dz + (df/dz)' mu, the slope of every stage's own l + mu' f."""
        return self.slope + (self.mu[:, None] @ self.jacobian)[:, 0]


def _by_stage(values: np.ndarray, factors: np.ndarray) -> np.ndarray:
    """(n, m, N) values times factors (n, m), the stages first."""
    return np.multiply(values.transpose(2, 0, 1), factors, order="C")
