r"""Soft inequalities: rows g <= 0 that may be violated, at a price.

Instead of having to hold, such a row costs (Huber's function of what it is exceeded by)

.. math::
    p(g) = \begin{cases} 0 & g \le 0 \\ g^2 / (2 d) & 0 < g \le d P \\
    P g - d P^2 / 2 & d P < g \end{cases}

with P its price and d its compliance; without compliance p(g) = P max(0, g), the exact L1 penalty.
Its multiplier zeta lies between 0 and P, and g = d zeta where it lies below P: the row is kept as
it would be otherwise, or to g = d zeta, wherever that costs less than the price a unit.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, fields
from typing import Any, TypeAlias

import numpy as np
import sympy as sp

from ann_dc.errors import ProblemError
from ann_dc.problem.fields import is_finite, positive

Softness: TypeAlias = Any
"""A `Soft` or a price, of all rows or of every row by its name."""


@dataclass(frozen=True, kw_only=True)
class Soft:
    """What it costs to violate an inequality: ``soft=Soft(price=30)``.

    Parameters
    ----------
    price : float
        P, positive, in units of the cost by unit of the row (what stands on the left of ``<= 0``);
        infinite where only the compliance counts.
    compliance : float
        d, how far the row gives way for a multiplier of one: zero or positive, finite.

    Raises
    ------
    ProblemError
        If the price is not positive, the compliance negative or not finite, or there is neither.

    Examples
    --------
    >>> soft = Soft(price=30.0, compliance=0.01)
    >>> soft.cost(np.array([-1.0, 0.15, 0.3, 1.3])).round(6).tolist()
    [0.0, 1.125, 4.5, 34.5]
    """

    price: float = math.inf
    compliance: float = 0.0

    def __post_init__(self) -> None:
        put = lambda key, value: object.__setattr__(self, key, value)  # noqa: E731
        unlimited = isinstance(self.price, (float, sp.Expr)) and self.price == math.inf
        put("price", math.inf if unlimited else positive("soft.price", self.price))
        if not (is_finite(self.compliance) and self.compliance >= 0):
            raise ProblemError(
                f"soft.compliance: expected a number from zero on, got {self.compliance!r}"
            )
        put("compliance", float(self.compliance))
        if unlimited and not self.compliance:
            raise ProblemError(
                "soft: neither a finite price nor a compliance; give one of them, or leave the row "
                "as it is: it has to hold then"
            )

    def cost(self, g: np.ndarray) -> np.ndarray:
        """p(g), element by element, in the unit of the cost.

        Parameters
        ----------
        g : array
            In the row's own unit.
        """
        over = np.maximum(g, 0.0)
        if not self.compliance:
            return self.price * over
        bent = np.minimum(over, self.compliance * self.price)
        beyond = over - bent
        straight = np.where(beyond > 0.0, beyond, 0.0) * min(self.price, np.finfo(float).max)
        return bent**2 / (2.0 * self.compliance) + straight

    def __str__(self) -> str:
        told = [f"{self.price:g} a unit"] if self.price < math.inf else []
        told += [f"compliance {self.compliance:g}"] if self.compliance else []
        return f"soft ({', '.join(told)})"


def soft_of(given: Any, rows: Collection[Any], limited: Collection[str]) -> dict[str, Soft]:
    """Soft rows by name.

    Parameters
    ----------
    given : Soft, float, or mapping of str to either or to a table of both numbers
        A number is a price; one without a name is that of all rows.
    rows : collection of str
        Names of the rows.
    limited : collection of str
        Controls with limits.

    Raises
    ------
    ProblemError
        If there is nothing to soften, no row of that name, or what is given is no price.
    """
    if not isinstance(given, Mapping):
        if not rows:
            raise ProblemError(
                "soft: the problem has no inequality that could be soft; limits of controls are "
                "rails, which always hold"
            )
        return dict.fromkeys(rows, _soft("soft", given))
    found = {}
    for name, value in given.items():
        if name not in rows:
            for control in limited:
                if name in (control, f"{control}_low", f"{control}_high"):
                    raise ProblemError(
                        f"soft[{name}]: {control} is a control, and its limits are rails, which "
                        "always hold; write the limit as one of the constraints to make it soft"
                    )
            raise ProblemError(
                f"soft: there is no row {name!r}; give one of {', '.join(rows) or 'none'}"
            )
        found[name] = _soft(f"soft[{name}]", value)
    return found


def _soft(where: str, given: Any) -> Soft:
    """One that is given as such, as a price, or as a table of both numbers."""
    if isinstance(given, Soft):
        return given
    table = given if isinstance(given, Mapping) else {"price": given}
    for key in table:
        if key not in (known := [field.name for field in fields(Soft)]):
            raise ProblemError(f"{where}: unknown key {key!r}; a soft row has {', '.join(known)}")
    try:
        return Soft(**table)
    except ProblemError as error:
        raise ProblemError(f"{where}{str(error).removeprefix('soft')}") from error
