"""Derivatives of formulas that share subexpressions, by the chain rule over these.

A rule of Runge and Kutta composes a map four times with itself. Written out, its second derivatives
have many times as many terms as the map. Here every shared subexpression becomes a variable, as in
forward-mode automatic differentiation (Griewank and Walther, Evaluating Derivatives, chapter 3).
The derivatives of the network are not used, since these functions certify it.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations_with_replacement
from typing import Any

import sympy as sp


class ChainRule:
    """Formulas as assignments to variables, with their derivatives in some symbols.

    Parameters
    ----------
    formulas : sequence of sympy.Expr
        Formulas whose subexpressions are shared.
    z : sequence of sympy.Symbol
        Symbols of the derivatives.

    Attributes
    ----------
    assignments : list of (sympy.Symbol, sympy.Expr)
        Variables in the order of their computation.
    values : list of sympy.Expr
        The formulas in terms of the variables.

    Examples
    --------
    >>> x, y = sp.symbols("x y")
    >>> shared = ChainRule([sp.exp(x * y) + sp.sin(x * y)], [x, y])
    >>> slope = shared.slopes(shared.values[0])[0]
    >>> for name, formula in reversed(shared.assignments):
    ...     slope = slope.subs(name, formula)
    >>> sp.simplify(slope - (sp.exp(x * y) + sp.sin(x * y)).diff(x))
    0
    """

    def __init__(self, formulas: Sequence[sp.Expr], z: Sequence[sp.Symbol]) -> None:
        self.z = list(z)
        self.assignments: list[tuple[sp.Symbol, sp.Expr]] = []
        self._slopes: dict[Any, list[Any]] = {
            symbol: [sp.S(int(i == j)) for j in range(len(self.z))] for i, symbol in enumerate(z)
        }
        self._curvatures: dict[Any, dict[tuple[int, int], Any]] = {s: {} for s in self.z}
        self._names = sp.numbered_symbols("v", cls=sp.Dummy)
        shared, reduced = sp.cse(list(formulas), symbols=self._names)
        for variable, formula in shared:
            self._assign(variable, formula)
        self.values = [self._variable(formula) for formula in reduced]

    def slopes(self, value: sp.Expr) -> list[Any]:
        """Return the first derivatives of a value in ``z``."""
        return self._slopes.get(value, [sp.S.Zero] * len(self.z))

    def hessian(self, value: sp.Expr) -> list[Any]:
        """Return the second derivatives of a value in ``z``, row by row."""
        entries, size = self._curvatures.get(value, {}), range(len(self.z))
        return [entries.get((min(i, j), max(i, j)), sp.S.Zero) for i in size for j in size]

    def weighted(self, weights: Sequence[sp.Expr], values: Sequence[sp.Expr]) -> sp.Expr:
        """Return the variable of a sum of values with weights that do not depend on ``z``."""
        return self._variable(sum(map(sp.Mul, weights, values), start=sp.S.Zero))

    def _variable(self, formula: Any) -> sp.Expr:
        """Return an atom that has the value of a formula."""
        if formula.is_Atom:
            return formula
        variable = next(self._names)
        self._assign(variable, formula)
        return variable

    def _assign(self, variable: sp.Symbol, formula: sp.Expr) -> None:
        """Append a variable, and those of its derivatives."""
        self.assignments.append((variable, formula))
        symbols = formula.free_symbols
        inner = [v for v in self._slopes if v in symbols]
        if not inner:
            return
        outer = {v: formula.diff(v) for v in inner}
        first = {v: self._named(outer[v]) for v in inner}
        pairs = list(combinations_with_replacement(inner, 2))
        second = {(v, w): self._named(outer[v].diff(w)) for v, w in pairs}
        size = range(len(self.z))
        self._slopes[variable] = [
            self._named(sum((first[v] * self._slopes[v][j] for v in inner), start=sp.S.Zero))
            for j in size
        ]
        self._curvatures[variable] = {}
        for i, j in combinations_with_replacement(size, 2):
            terms = [first[v] * self._curvatures[v].get((i, j), 0) for v in inner]
            for v, w in pairs:
                twice = self._slopes[v][i] * self._slopes[w][j]
                if v is not w:
                    twice += self._slopes[w][i] * self._slopes[v][j]
                terms.append(second[v, w] * twice)
            entry = self._named(sum(terms, start=sp.S.Zero))
            if entry != 0:
                self._curvatures[variable][i, j] = entry

    def _named(self, formula: sp.Expr) -> sp.Expr:
        """Return a new variable for a formula, or the formula if it is an atom."""
        if formula.is_Atom:
            return formula
        variable = next(self._names)
        self.assignments.append((variable, formula))
        return variable
