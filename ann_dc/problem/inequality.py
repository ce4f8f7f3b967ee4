"""Inequality constraints: named SymPy relations, converted to rows g <= 0.

A strict relation is replaced by its closure, because an optimum may lie on the boundary.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
import sympy as sp

from ann_dc.errors import ProblemError
from ann_dc.problem.fields import by_name, check_names, smooth_expression
from ann_dc.problem.soft import Soft

PREFIXES = {"constraints": "g", "terminal_constraints": "end"}
"""Prefixes of the numbered names of unnamed relations."""

SIGNS = {"<=": sp.Le, "<": sp.Lt, ">=": sp.Ge, ">": sp.Gt}
"""Relation signs in text form."""

NO_INEQUALITIES = {
    sp.Equality: "an equality; express it by the map, q_0 or q_d, or use two inequalities with a "
    "tolerance",
    sp.Unequality: "not an inequality; write <= or >=",
    sp.logic.boolalg.BooleanFunction: "a combination of relations; list each relation separately",
}
"""Unsupported relations with a description and a remedy."""

Relations: TypeAlias = Mapping[str, sp.Rel] | Sequence[sp.Rel]


@dataclass(frozen=True, kw_only=True)
class Inequality:
    """Row g <= 0 with g in states, controls and inputs; `soft` is None for a hard constraint."""

    name: str
    expression: sp.Expr
    soft: Soft | None = None

    def __str__(self) -> str:
        return f"{self.name}: {self.expression} <= 0{f', {self.soft}' if self.soft else ''}"


def relations_of(
    field: str, given: Any, known: set[sp.Symbol], data: set[sp.Symbol], bounds: Collection[str]
) -> dict[str, sp.Rel]:
    """Return relations by name, each a smooth inequality in known symbols.

    A relation needs a symbol that is not among the ``data``. The rows of bounded quantities have
    names too. Raises `ProblemError`, which begins with the field, one of `PREFIXES`.
    """
    expected = "relations such as [x <= 1], or a mapping of name to relation"
    relations = by_name(field, given, PREFIXES[field], expected)
    taken = [row_name(bounded, side) for bounded in bounds for side in ("low", "high")]
    _check_names(field, [*relations, *taken])
    for name, relation in relations.items():
        g = smooth_expression(f"{field}[{name}]", _excess(f"{field}[{name}]", relation), known)
        if not g.free_symbols - data:
            raise ProblemError(
                f"{field}[{name}]: {relation} has none of "
                f"{', '.join(sorted(map(str, known - data)))} and cannot be influenced; omit it"
            )
    return relations


def row_name(bounded: str, side: str) -> str:
    """Return the row name of a bound, free of the double "_" reserved for netlists."""
    return f"{bounded.rstrip('_')}_{side}"


def _check_names(field: str, names: Sequence[Any]) -> None:
    for name in names:
        if not isinstance(name, str):
            raise ProblemError(f'{field}: expected names such as "disc", got {name!r}')
    try:
        check_names([sp.Symbol(name) for name in names], [])
    except ProblemError as error:
        raise ProblemError(f"{field}: {error}") from error


def excess(relation: Any) -> sp.Expr:
    """Return g of a relation that is equivalent to g <= 0."""
    left, right = relation.args
    return right - left if isinstance(relation, (sp.Ge, sp.Gt)) else left - right


def _excess(where: str, relation: Any) -> sp.Expr:
    """Return g of an object, or raise a `ProblemError` if it is not an inequality."""
    if isinstance(relation, tuple(SIGNS.values())):
        return excess(relation)
    if isinstance(relation, (bool, np.bool_, sp.logic.boolalg.BooleanAtom)):
        raise ProblemError(
            f"{where}: the relation is {relation} for all states and controls; omit it, or "
            "compare symbols of the problem"
        )
    for kind, words in NO_INEQUALITIES.items():
        if isinstance(relation, kind):
            raise ProblemError(f"{where}: {relation} is {words}")
    raise ProblemError(f"{where}: expected a SymPy relation such as x <= 1, got {relation!r}")
