r"""Whether a point minimises the largest of several objectives: their shares of the cost.

.. math:: \zeta \ge 0, \qquad \sum_i \zeta_i = 1, \qquad \zeta_i (J_{max} - J_i) = 0,

with w_i J_i in place of J_i where there are weights; differences are told over what the stages add
to an objective, each by its size, so that nothing depends on units. At a temperature T the last of
these is zeta_i = exp((J_i - E) / T), where E = T log sum_i exp(J_i / T) is the largest, softened.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ann_dc.problem.declaration import OptimalControlProblem

LARGEST_MISS = 1e-6
"""Of the sum, a sign or a product at a certified point."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Largest:
    """The objectives of a point.

    Attributes
    ----------
    names : tuple of str
    values : (p,) array
        w_i J_i, in the user's units.
    shares : (p,) array
        zeta.
    size : float
        What a difference of objectives is related to.
    temperature : float
        T, in the user's units; zero where the largest itself is minimised.
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
        """Those of a path; None where the problem has no objectives.

        Parameters
        ----------
        problem : OptimalControlProblem
        q : (n, N+1) array
            States with the end.
        u : (m, N) array
        shares : (p,) array, optional
            Equal ones where they are not given.
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
        """The largest objective, softened at a temperature."""
        largest = float(self.values.max())
        if not self.temperature:
            return largest
        above = np.exp((self.values - largest) / self.temperature).sum()
        return largest + self.temperature * float(np.log(above))

    @property
    def excess(self) -> float:
        """The level less the sum that the shares make of all objectives."""
        return self.level - float(self.shares @ self.values)

    @property
    def miss(self) -> float:
        """How far the sum of shares is from one, or a share below zero, at most."""
        return float(np.max([abs(self.shares.sum() - 1.0), *-self.shares]))

    @property
    def product(self) -> float:
        """The largest share times the relative distance of its objective from where it is due.

        That is the level; at a temperature as much below it as the share is less than one.
        """
        shares = np.abs(self.shares)
        below = np.log(shares, where=shares > 0, out=np.zeros_like(shares))
        due = self.level + self.temperature * below
        return float((shares * np.abs(due - self.values)).max() / self.size)

    @property
    def holds(self) -> bool:
        """Whether all is below `LARGEST_MISS`."""
        return bool(np.max([self.miss, self.product]) < LARGEST_MISS)

    @property
    def reason(self) -> str:
        """What does not hold, in words; empty where all does."""
        if not self.miss < LARGEST_MISS:
            return f"the shares of the objectives miss one, or are negative, by {self.miss:.1e}"
        if not self.product < LARGEST_MISS and self.temperature:
            return f"an objective is away from where its share has it, by {self.product:.1e}"
        if not self.product < LARGEST_MISS:
            return f"an objective with a share is not the largest, by {self.product:.1e}"
        return ""

    @property
    def counts(self) -> str:
        """Every objective with its share, in words."""
        told = zip(self.names, self.values, self.shares)
        return ", ".join(f"{name} {value:.6g} (share {share:.4f})" for name, value, share in told)

    def as_dict(self) -> dict[str, dict[str, float]]:
        """Plain data for JSON: value and share of every objective."""
        told = zip(self.names, self.values.tolist(), self.shares.tolist())
        return {name: {"value": value, "share": share} for name, value, share in told}

    def __str__(self) -> str:
        return f"objectives             {self.counts}"
