"""Inequalities that a user writes: SymPy relations, each with a name, as g <= 0.

A strict relation counts as its closure: an optimum may lie on the boundary.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
import sympy as sp

from ann_dc.errors import ProblemError
from ann_dc.problem.fields import check_names, smooth_expression
from ann_dc.problem.soft import Soft

PREFIXES = {"constraints": "g", "terminal_constraints": "end"}
"""What relations that have no name are called, with a number."""

SIGNS = {"<=": sp.Le, "<": sp.Lt, ">=": sp.Ge, ">": sp.Gt}
"""Inequalities as text writes them."""

NO_INEQUALITIES = {
    sp.Equality: "an equality; let the map, q_0 or q_d say it, or give room on either side of it",
    sp.Unequality: "no inequality, and smooth on neither side; write <= or >=",
    sp.logic.boolalg.BooleanFunction: "a combination of relations; give every one by itself",
}
"""Other relations: what they are, and what to do."""

Relations: TypeAlias = Mapping[str, sp.Rel] | Sequence[sp.Rel]


@dataclass(frozen=True, kw_only=True)
class Inequality:
    """A row g <= 0.

    Attributes
    ----------
    name : str
    expression : sympy.Expr
        g, in states, controls and inputs.
    soft : Soft or None
        What it costs to violate it; None where it has to hold.

    Examples
    --------
    >>> import ann_dc
    >>> x, a = sp.symbols("x a")
    >>> problem = ann_dc.OptimalControlProblem(
    ...     states=(x,), controls=(a,), map=(x + a,), cost=a**2, horizon=3, q_0=(2,),
    ...     constraints={"disc": x**2 + a**2 >= 1}, bounds={x: (0, None)})
    >>> for row in problem.inequalities:
    ...     print(row)
    disc: -a**2 - x**2 + 1 <= 0
    x_low: -x <= 0
    """

    name: str
    expression: sp.Expr
    soft: Soft | None = None

    def __str__(self) -> str:
        return f"{self.name}: {self.expression} <= 0{f', {self.soft}' if self.soft else ''}"


def relations_of(
    field: str, given: Any, known: set[sp.Symbol], data: set[sp.Symbol], bounds: Collection[str]
) -> dict[str, sp.Rel]:
    """Relations by name, each a smooth inequality.

    Parameters
    ----------
    field : str
        One of `PREFIXES`; errors begin with it.
    given : mapping of str to relation, or sequence of relations
    known : set of Symbol
        What a relation may name.
    data : set of Symbol
        Those of them that are given numbers: a relation names another one too.
    bounds : collection of str
        What has bounds: their rows have names, too.

    Raises
    ------
    ProblemError
        If one is no smooth inequality, or names nothing that can be chosen, or its own name is not
        a plain one.
    """
    relations = _named(field, given)
    taken = [row_name(bounded, side) for bounded in bounds for side in ("low", "high")]
    _check_names(field, [*relations, *taken])
    for name, relation in relations.items():
        g = smooth_expression(f"{field}[{name}]", _excess(f"{field}[{name}]", relation), known)
        if not g.free_symbols - data:
            raise ProblemError(
                f"{field}[{name}]: {relation} has none of "
                f"{', '.join(sorted(map(str, known - data)))} in it, so that nothing can make it "
                "hold; leave it out"
            )
    return relations


def row_name(bounded: str, side: str) -> str:
    """What the row of a bound is called; a double "_" is what netlists write before a stage."""
    return f"{bounded.rstrip('_')}_{side}"


def _named(field: str, given: Any) -> dict[Any, Any]:
    if isinstance(given, Mapping):
        return dict(given)
    if isinstance(given, Sequence) and not isinstance(given, (str, bytes)):
        return {f"{PREFIXES[field]}{number}": relation for number, relation in enumerate(given, 1)}
    raise ProblemError(
        f"{field}: expected a sequence of relations such as [x <= 1], or a mapping of name to "
        f"relation, got {given!r}"
    )


def _check_names(field: str, names: Sequence[Any]) -> None:
    for name in names:
        if not isinstance(name, str):
            raise ProblemError(f'{field}: expected names such as "disc", got {name!r}')
    try:
        check_names([sp.Symbol(name) for name in names], [])
    except ProblemError as error:
        raise ProblemError(f"{field}: {error}") from error


def excess(relation: Any) -> sp.Expr:
    """g of a relation that says g <= 0."""
    left, right = relation.args
    return right - left if isinstance(relation, (sp.Ge, sp.Gt)) else left - right


def _excess(where: str, relation: Any) -> sp.Expr:
    """The same of anything; a ProblemError where it is no inequality."""
    if isinstance(relation, tuple(SIGNS.values())):
        return excess(relation)
    if isinstance(relation, (bool, np.bool_, sp.logic.boolalg.BooleanAtom)):
        raise ProblemError(
            f"{where}: the relation is {relation} whatever the states and controls are; leave it "
            "out, or compare symbols of the problem"
        )
    for kind, words in NO_INEQUALITIES.items():
        if isinstance(relation, kind):
            raise ProblemError(f"{where}: {relation} is {words}")
    raise ProblemError(f"{where}: expected a SymPy relation such as x <= 1, got {relation!r}")
