"""Inequalities that a user writes: SymPy relations, each with a name, as g <= 0.

A strict relation counts as its closure: an optimum may lie on the boundary.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass
from typing import Any, TypeAlias

import sympy as sp

from ann_dc.errors import ProblemError
from ann_dc.problem.fields import check_names, smooth_expression

INSTEAD = {
    sp.Equality: "an equality; put it into the map, or give two inequalities that leave room",
    sp.Unequality: "an inequation, which no optimum can lie on the edge of; write <= or >=",
    sp.And: "more than one relation; give each of them by itself",
    sp.Or: "a choice between relations, which is not smooth; give one of them",
}
"""Logic that is no inequality: what it is, and what to do."""

Relations: TypeAlias = Mapping[str, sp.Rel] | Sequence[sp.Rel]


@dataclass(frozen=True, kw_only=True)
class Inequality:
    """A row g <= 0.

    Attributes
    ----------
    name : str
    expression : sympy.Expr
        g, in states, controls and inputs.

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

    def __str__(self) -> str:
        return f"{self.name}: {self.expression} <= 0"


def relations_of(
    field: str, given: Any, prefix: str, known: set[sp.Symbol], data: Set[sp.Symbol]
) -> dict[str, sp.Rel]:
    """Relations by name; of a sequence, the prefix and a number are the name.

    Parameters
    ----------
    field : str
        What errors begin with.
    given : mapping of str to relation, or sequence of relations
    prefix : str
    known : set of Symbol
        What a relation may name.
    data : set of Symbol
        Those of them that are given numbers: a relation names another one too.

    Raises
    ------
    ProblemError
        If one is no inequality, is not smooth, or decides nothing, or a name is not a plain one.
    """
    relations = _named(field, given, prefix)
    _check_names(field, [*relations])
    for name, relation in relations.items():
        where = f"{field}[{name}]"
        g = smooth_expression(where, _expression(where, relation), known)
        if not g.free_symbols - data:
            raise ProblemError(
                f"{where}: {relation} names none of {', '.join(sorted(map(str, known - data)))}, "
                "so that nothing can be done about it; leave it out"
            )
    return relations


def _named(field: str, given: Any, prefix: str) -> dict[Any, Any]:
    if isinstance(given, Mapping):
        return dict(given)
    if isinstance(given, Sequence) and not isinstance(given, (str, bytes)):
        return {f"{prefix}{number}": relation for number, relation in enumerate(given, 1)}
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


def _expression(where: str, relation: Any) -> sp.Expr:
    """g of g <= 0."""
    if isinstance(relation, (sp.LessThan, sp.StrictLessThan)):
        return relation.lhs - relation.rhs
    if isinstance(relation, (sp.GreaterThan, sp.StrictGreaterThan)):
        return relation.rhs - relation.lhs
    if relation in (True, False):
        raise ProblemError(
            f"{where}: the relation is {relation} whatever the states and controls are (by what is "
            "assumed of its symbols); leave it out, or write it with symbols of the problem"
        )
    for kind, words in INSTEAD.items():
        if isinstance(relation, kind):
            raise ProblemError(f"{where}: {relation} is {words}")
    raise ProblemError(f"{where}: expected a relation such as x <= 1, got {relation!r}")


def inequalities_of(relations: Mapping[str, sp.Rel]) -> tuple[Inequality, ...]:
    """Relations, which `relations_of` has checked, as rows g <= 0."""
    return tuple(
        Inequality(name=name, expression=_expression(name, relation))
        for name, relation in relations.items()
    )
