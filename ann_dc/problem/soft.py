r"""Soft inequality constraints: penalised violation of rows g <= 0.

A soft row is replaced by a penalty (Huber function of the violation)

.. math::
    p(g) = \begin{cases} 0 & g \le 0 \\ g^2 / (2 d) & 0 < g \le d P \\
    P g - d P^2 / 2 & d P < g \end{cases}

with the penalty weight P (`weight`) and the compliance d. Without compliance p(g) = P max(0, g),
the exact L1 penalty. The multiplier zeta lies between 0 and P, and g = d zeta if zeta < P. The row
is therefore satisfied exactly, or to g = d zeta, wherever that costs less than P per unit.
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
"""A `Soft` or a penalty weight, of all rows or of each row by name."""


@dataclass(frozen=True, kw_only=True)
class Soft:
    """Penalty of a violated inequality: ``soft=Soft(weight=30)``.

    Parameters
    ----------
    weight : float
        Penalty weight P, positive, in units of the cost per unit of the row (the left side of ``<=
        0``). Infinite, the default, if only the compliance is used.
    compliance : float
        Compliance d, the violation per unit of the multiplier; non-negative, finite.

    Raises
    ------
    ProblemError
        If the weight is not positive, the compliance is negative or not finite, or both are
        missing.

    Examples
    --------
    >>> soft = Soft(weight=30.0, compliance=0.01)
    >>> soft.cost(np.array([-1.0, 0.15, 0.3, 1.3])).round(6).tolist()
    [0.0, 1.125, 4.5, 34.5]
    """

    weight: float = math.inf
    compliance: float = 0.0

    def __post_init__(self) -> None:
        put = lambda key, value: object.__setattr__(self, key, value)  # noqa: E731
        unlimited = isinstance(self.weight, (float, sp.Expr)) and self.weight == math.inf
        put("weight", math.inf if unlimited else positive("soft.weight", self.weight))
        if not (is_finite(self.compliance) and self.compliance >= 0):
            raise ProblemError(
                f"soft.compliance: expected a number of at least 0, got {self.compliance!r}"
            )
        put("compliance", float(self.compliance))
        if unlimited and not self.compliance:
            raise ProblemError(
                "soft: expected a finite weight or a compliance, got neither; add one, or keep "
                "the constraint hard"
            )

    def cost(self, g: np.ndarray) -> np.ndarray:
        """Return the penalty p(g) elementwise, in the unit of the cost.

        Parameters
        ----------
        g : array
            Values of the row in its unit.
        """
        over = np.maximum(g, 0.0)
        if not self.compliance:
            return self.weight * over
        bent = np.minimum(over, self.compliance * self.weight)
        beyond = over - bent
        straight = np.where(beyond > 0.0, beyond, 0.0) * min(self.weight, np.finfo(float).max)
        return bent**2 / (2.0 * self.compliance) + straight

    def __str__(self) -> str:
        reported = [f"{self.weight:g} per unit"] if self.weight < math.inf else []
        reported += [f"compliance {self.compliance:g}"] if self.compliance else []
        return f"soft ({', '.join(reported)})"


def soft_of(given: Any, rows: Collection[Any], limited: Collection[str]) -> dict[str, Soft]:
    """Return soft rows by name; a value without a name applies to all rows.

    A number is a penalty weight. Raises `ProblemError` if the problem has no rows, a name is
    unknown or one of the limited controls, or a value is not a penalty weight.
    """
    if not isinstance(given, Mapping):
        if not rows:
            raise ProblemError(
                "soft: the problem has no inequality constraint; control bounds are hard, use "
                "constraints= to soften one"
            )
        return dict.fromkeys(rows, _soft("soft", given))
    found = {}
    for name, value in given.items():
        if name not in rows:
            for control in limited:
                if name in (control, f"{control}_low", f"{control}_high"):
                    raise ProblemError(
                        f"soft[{name}]: {control} is a control, whose bounds are hard; use "
                        "constraints= to soften a bound"
                    )
            raise ProblemError(
                f"soft: unknown constraint {name!r}; choose one of {', '.join(rows) or 'none'}"
            )
        found[name] = _soft(f"soft[{name}]", value)
    return found


def _soft(where: str, given: Any) -> Soft:
    """Return a `Soft` given as such, as penalty weight, or as table of both numbers."""
    if isinstance(given, Soft):
        return given
    table = given if isinstance(given, Mapping) else {"weight": given}
    for key in table:
        if key not in (known := [field.name for field in fields(Soft)]):
            raise ProblemError(
                f"{where}: unknown key {key!r}; a soft constraint has {', '.join(known)}"
            )
    try:
        return Soft(**table)
    except ProblemError as error:
        raise ProblemError(f"{where}{str(error).removeprefix('soft')}") from error
