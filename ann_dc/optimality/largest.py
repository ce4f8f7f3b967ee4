r"""Optimality conditions of a minimax objective: cost weights of the objectives.

.. math:: \zeta \ge 0, \qquad \sum_i \zeta_i = 1, \qquad \zeta_i (J_{max} - J_i) = 0,

where w_i J_i replaces J_i if there are weights. Differences are relative to the sum over the stages
of the absolute contributions to an objective, so the result does not depend on units. At a
temperature T the last condition becomes zeta_i = exp((J_i - E) / T), where E = T log sum_i exp(J_i
/ T) is the softened maximum.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ann_dc.problem.declaration import OptimalControlProblem

LARGEST_MISS = 1e-6
"""Upper limit of the errors of sum, sign and product at a certified point."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Largest:
    """Objectives of a point: w_i J_i (p,) in the user's units and their coefficients zeta (p,).

    `size` is the reference of differences. The temperature T is zero if the maximum itself is
    minimised.
    """

    names: tuple[str, ...]
    values: np.ndarray
    shares: np.ndarray
    size: float
    temperature: float = 0.0

    @classmethod
    def of(
        cls, problem: OptimalControlProblem, q: np.ndarray, u: np.ndarray, shares: np.ndarray | None
    ) -> Largest | None:
        """Compute the objectives of a path; None if the problem has no objectives.

        `q` (n, N+1) includes the end, `u` is (m, N). `shares` (p,) are equal by default.
        """
        if not problem.objectives:
            return None
        with np.errstate(all="ignore"):
            stages = problem.objective_stages(q, u)
            size = float(np.abs(stages).sum(axis=1).max())
            count = len(stages)
            return cls(
                names=problem.objective_names,
                values=stages.sum(axis=1),
                shares=np.full(count, 1.0 / count) if shares is None else shares,
                size=size if size > 0 else 1.0,
                temperature=problem.temperature,
            )

    @property
    def level(self) -> float:
        """Largest objective, softened if the temperature is positive."""
        largest = float(self.values.max())
        if not self.temperature:
            return largest
        above = np.exp((self.values - largest) / self.temperature).sum()
        return largest + self.temperature * float(np.log(above))

    @property
    def excess(self) -> float:
        """Difference of the level and the sum of the objectives weighted by `shares`."""
        return self.level - float(self.shares @ self.values)

    @property
    def miss(self) -> float:
        """Largest deviation of the sum of `shares` from one, or largest negative value."""
        return float(np.max([abs(self.shares.sum() - 1.0), *-self.shares]))

    @property
    def product(self) -> float:
        """Largest product of `shares` and relative distance to the required objective.

        The distance is relative to `size`. The required value is the level plus T log(zeta_i).
        """
        shares = np.abs(self.shares)
        below = np.log(shares, where=shares > 0, out=np.zeros_like(shares))
        due = self.level + self.temperature * below
        return float((shares * np.abs(due - self.values)).max() / self.size)

    @property
    def reason(self) -> str:
        """Description of the condition that fails; empty if all hold."""
        if not self.miss < LARGEST_MISS:
            return f"the shares of the objectives miss one, or are negative, by {self.miss:.1e}"
        if not self.product < LARGEST_MISS and self.temperature:
            return f"an objective is away from where its share has it, by {self.product:.1e}"
        if not self.product < LARGEST_MISS:
            return f"an objective with a share is not the largest, by {self.product:.1e}"
        return ""

    @property
    def counts(self) -> str:
        """Objectives with their shares, as text."""
        told = zip(self.names, self.values, self.shares)
        return ", ".join(f"{name} {value:.6g} (share {share:.4f})" for name, value, share in told)

    def as_dict(self) -> dict[str, dict[str, float]]:
        """Return value and `share` of every objective as plain data for JSON."""
        told = zip(self.names, self.values.tolist(), self.shares.tolist())
        return {name: {"value": value, "share": share} for name, value, share in told}

    def __str__(self) -> str:
        return f"objectives             {self.counts}"
