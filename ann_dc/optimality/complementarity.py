r"""Complementarity conditions of inequalities and of minimax objectives at a point.

.. math:: g \le 0, \qquad \zeta \ge 0, \qquad \zeta_i g_i = 0,

A distance is relative to the range of the variables that the constraint reads, a multiplier to the
largest multiplier. The result therefore does not depend on units or on the scaling of a constraint.
Control limits count as constraints. For a soft constraint, g - d zeta replaces g, and its penalty
weight bounds zeta from above.

The cost weights of the objectives in a minimax problem satisfy

.. math:: \zeta \ge 0, \qquad \sum_i \zeta_i = 1, \qquad \zeta_i (J_{max} - J_i) = 0,

where w_i J_i replaces J_i if there are weights. Differences are relative to the sum over the stages
of the absolute contributions to an objective, so the result does not depend on units. At a
temperature T the last condition becomes zeta_i = exp((J_i - E) / T), where E = T log sum_i exp(J_i
/ T) is the softened maximum.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ann_dc.optimality.contact import Contact
from ann_dc.problem.declaration import OptimalControlProblem

LARGEST_MISS = 1e-6
"""Upper limit of the relative errors of a certified point."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Complementarity:
    """Complementarity residuals of a point.

    `violation` is relative to the range of the variables that the constraint reads. `wrong_sign` is
    the most negative multiplier, or the largest excess over a penalty weight, relative to the
    largest multiplier. `product` is that of distance and multiplier, both relative. The numbers
    count strongly active (nonzero multiplier), weakly active and inactive constraints of all
    stages, the end and limited controls.
    """

    violation: float
    wrong_sign: float
    product: float
    strong: int
    weak: int
    inactive: int

    @classmethod
    def of(cls, contact: Contact, size: float) -> Complementarity:
        """Compute the residuals; `size` is the largest gradient entry or multiplier."""
        near, strong = contact.near, contact.strong(size)
        largest = lambda values: float(values.max(initial=0.0)) + 0.0  # noqa: E731
        return cls(
            violation=largest(contact.distance),
            wrong_sign=largest(-np.minimum(contact.multiplier, contact.room)) / size,
            product=largest(contact.product) / size,
            strong=int(strong.sum()),
            weak=int((near & ~strong).sum()),
            inactive=int((contact.is_row & ~near).sum()),
        )

    @property
    def counts(self) -> str:
        """Numbers of active and inactive constraints, as text."""
        return f"{self.strong} strongly active, {self.weak} weakly, {self.inactive} inactive"

    @property
    def reason(self) -> str:
        """Description of the first condition that fails; empty if all hold."""
        reported = {
            f"an inequality is violated by {self.violation:.1e} of a range": self.violation,
            f"a multiplier has the wrong sign by {self.wrong_sign:.1e} of the largest multiplier":
                self.wrong_sign,
            "the product of distance and multiplier of an inactive inequality is "
                f"{self.product:.1e}":
                self.product,
        }  # fmt: skip
        wrong = [words for words, value in reported.items() if not value < LARGEST_MISS]
        return f"{wrong[0]}, which is not below {LARGEST_MISS:g}" if wrong else ""

    def __str__(self) -> str:
        return "\n".join(
            [
                f"inequalities           {self.counts}",
                f"violation              {self.violation:.2e}",
                f"wrong signs            {self.wrong_sign:.2e}",
                f"complementarity        {self.product:.2e}",
            ]
        )


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
            return (
                "the weights of the objectives differ from a sum of one, or are negative, by "
                f"{self.miss:.1e}"
            )
        if not self.product < LARGEST_MISS and self.temperature:
            return f"an objective differs from the value of its weight by {self.product:.1e}"
        if not self.product < LARGEST_MISS:
            return f"an objective with a positive weight is below the largest by {self.product:.1e}"
        return ""

    @property
    def counts(self) -> str:
        """Objectives with their shares, as text."""
        reported = zip(self.names, self.values, self.shares)
        return ", ".join(
            f"{name} {value:.6g} (share {share:.4f})" for name, value, share in reported
        )

    def as_dict(self) -> dict[str, dict[str, float]]:
        """Return value and `share` of every objective as plain data for JSON."""
        reported = zip(self.names, self.values.tolist(), self.shares.tolist())
        return {name: {"value": value, "share": share} for name, value, share in reported}

    def __str__(self) -> str:
        return f"objectives             {self.counts}"
