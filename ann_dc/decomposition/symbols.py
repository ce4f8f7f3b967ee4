"""Names for what a decomposition adds to the user's own symbols, and numbers for reading."""

from __future__ import annotations

from typing import Any

import sympy as sp

from ann_dc.problem.declaration import OptimalControlProblem


def fresh(name: str, problem: OptimalControlProblem) -> sp.Symbol:
    """A symbol of that name, with a trailing '_' where the user has taken it.

    Parameters
    ----------
    name : str
    problem : OptimalControlProblem

    Returns
    -------
    sympy.Symbol
    """
    taken = {s.name for s in (*problem.states, *problem.controls, *problem.inputs)}
    while name in taken:
        name += "_"
    return sp.Symbol(name)


def rounded(expression: sp.Expr) -> Any:
    """The expression with its numbers to six digits, for reading.

    Parameters
    ----------
    expression : sympy.Expr

    Returns
    -------
    sympy.Expr
    """
    return expression.xreplace({n: sp.Float(f"{float(n):.6g}") for n in expression.atoms(sp.Float)})
