r"""Complementarity conditions of inequalities at a point.

.. math:: g \le 0, \qquad \zeta \ge 0, \qquad \zeta_i g_i = 0,

A distance is relative to the range of the variables that the constraint reads, a multiplier to the
largest multiplier. The result therefore does not depend on units or on the scaling of a constraint.
Control limits count as constraints. For a soft constraint, g - d zeta replaces g, and its penalty
weight bounds zeta from above.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ann_dc.optimality.contact import Contact

LARGEST_MISS = 1e-6
"""Upper limit of violation, wrong sign and product at a certified point."""


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
