"""Names of the symbols that a decomposition adds, and rounding for display."""

from __future__ import annotations

from typing import Any

import sympy as sp

from ann_dc.problem.declaration import OptimalControlProblem


def fresh(name: str, problem: OptimalControlProblem) -> sp.Symbol:
    """Return a symbol of that name, with a trailing '_' if the name is taken."""
    taken = {s.name for s in (*problem.states, *problem.controls, *problem.inputs)}
    while name in taken:
        name += "_"
    return sp.Symbol(name)


def rounded(expression: sp.Expr) -> Any:
    """Return the expression with its numbers rounded to six digits for display."""
    return expression.xreplace({n: sp.Float(f"{float(n):.6g}") for n in expression.atoms(sp.Float)})
