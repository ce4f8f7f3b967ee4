r"""Inequalities of a stage and of the end: rows g <= 0 with their multipliers.

They extend the Lagrangian (10) of a stage by

.. math:: L_k \mathrel{+}= \zeta_k^T g(q_k, u_k), \qquad \zeta_k \ge 0, \qquad
    \zeta_{k,i}\, g_i(q_k, u_k) = 0,

so that (11) and (12) contain one more potential. Rows of the end are added to the terminal cost, in
(14) of the last stage. The multiplier of a soft row is limited by the penalty weight, and the row
may settle at g = d zeta (`Soft`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import cast

import sympy as sp

from ann_dc.decomposition.symbols import fresh
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.problem.inequality import Inequality
from ann_dc.problem.soft import Soft


@dataclass(frozen=True, kw_only=True, eq=False)
class InequalityRow:
    """One row g <= 0 of a stage or of the end.

    Attributes
    ----------
    expression : sympy.Expr
        Function g in q and u of the stage; in t for a row of the end.
    multiplier : sympy.Symbol
        Multiplier zeta.
    at_end : bool
        True for a row of q_N alone.
    soft : Soft or None
        Cost of a violation; None for a hard constraint.
    """

    name: str
    expression: sp.Expr
    multiplier: sp.Symbol
    at_end: bool
    soft: Soft | None = None

    def __str__(self) -> str:
        where = "at the end, " if self.at_end else ""
        soft = f", {self.soft}" if self.soft else ""
        return f"{where}{self.multiplier} >= 0 presses {self.expression} <= 0{soft}"


def stage_rows(problem: OptimalControlProblem) -> tuple[InequalityRow, ...]:
    """Return the rows of every stage of a problem."""
    return tuple(_row(problem, given) for given in problem.inequalities)


def end_rows(
    problem: OptimalControlProblem, targets: Sequence[sp.Symbol]
) -> tuple[InequalityRow, ...]:
    """Return the rows of q_N, in the targets t (n symbols) of the last stage."""
    at_end = dict(zip(problem.states, targets))
    return tuple(_row(problem, given, at_end) for given in problem.end_inequalities)


def _row(
    problem: OptimalControlProblem,
    given: Inequality,
    at_end: dict[sp.Symbol, sp.Symbol] | None = None,
) -> InequalityRow:
    return InequalityRow(
        name=given.name,
        expression=cast(sp.Expr, given.expression.xreplace(at_end or {})),
        multiplier=fresh(f"zeta_{'end_' if at_end else ''}{given.name}", problem),
        at_end=at_end is not None,
        soft=given.soft,
    )


def pressed(rows: Sequence[InequalityRow]) -> sp.Expr:
    """Return the sum of zeta g over rows, their contribution to a Lagrangian."""
    return sp.Add(*(row.multiplier * row.expression for row in rows))
