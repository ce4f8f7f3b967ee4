r"""How well a point keeps its inequalities, and whether their multipliers are those of an optimum.

.. math:: g \le 0, \qquad \zeta \ge 0, \qquad \zeta_i g_i = 0,

each told relative to the problem itself: a distance over the range of what a row reads, a
multiplier over the largest one, so that nothing depends on units or on how a row was written. The
limits of a control count like rows. Of a soft row g - d zeta stands in the place of g, and zeta has
its price as an upper limit.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ann_dc.optimality.contact import Contact

LARGEST_MISS = 1e-6
"""Violation, wrong sign and product of a certified point, each."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Complementarity:
    """The inequalities of a point.

    Attributes
    ----------
    violation : float
        How far outside its worst row or limit the point lies, over the range of what that reads.
    wrong_sign : float
        The most negative multiplier over the largest one, as a positive number; or how far one is
        above the price of its row.
    product : float
        Largest distance to a row times its multiplier, both so related.
    strong, weak, inactive : int
        Rows of all stages and of the end, and controls that have limits: strongly active (they
        touch and pull), weakly active (they touch), and not.
    """

    violation: float
    wrong_sign: float
    product: float
    strong: int
    weak: int
    inactive: int

    @classmethod
    def of(cls, contact: Contact, size: float) -> Complementarity:
        """That of the rows around a point.

        Parameters
        ----------
        contact : Contact
        size : float
            The largest slope or multiplier.
        """
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
    def holds(self) -> bool:
        """Whether all three are below `LARGEST_MISS`."""
        return bool(np.max([self.violation, self.wrong_sign, self.product]) < LARGEST_MISS)

    @property
    def counts(self) -> str:
        """How many rows are active, in words."""
        return f"{self.strong} strongly active, {self.weak} weakly, {self.inactive} inactive"

    @property
    def reason(self) -> str:
        """What does not hold, in words; empty where all does."""
        told = {
            f"an inequality is violated by {self.violation:.1e} of a range": self.violation,
            f"a multiplier has the wrong sign by {self.wrong_sign:.1e} of the largest one":
                self.wrong_sign,
            f"a multiplier of an inequality that does not touch gives {self.product:.1e}":
                self.product,
        }  # fmt: skip
        wrong = [words for words, value in told.items() if not value < LARGEST_MISS]
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
