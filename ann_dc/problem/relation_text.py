"""Inequalities as text: ``x**2 + y**2 >= 1`` or, double, ``-1 <= x - y <= 1``.

`parse_expression` reads each side as a formula. The text is never executed, and the sides are not
evaluated or compared here.
"""

from __future__ import annotations

import re
from collections.abc import Mapping

import sympy as sp

from ann_dc.errors import ExpressionError
from ann_dc.problem.expression import parse_expression
from ann_dc.problem.inequality import SIGNS, row_name

SIGN = re.compile("([<>]=?)")
LONGEST = 60
"""Maximum number of letters of a text that an error message repeats."""


def parse_relations(
    name: str, text: object, symbols: Mapping[str, sp.Expr], where: str
) -> dict[str, sp.Rel]:
    """Read a single or double inequality from text.

    A double inequality gives ``name_low`` and ``name_high``. Formulas are separated by ``<=``,
    ``<``, ``>=`` or ``>``. The symbols give the meaning of each name; errors begin with the field
    of the text.

    Raises `ExpressionError` if the text is not an inequality, or if three formulas are not in
    order.

    Examples
    --------
    >>> x, y = sp.symbols("x y")
    >>> parse_relations("gap", "-1 <= x - y < 1", {"x": x, "y": y}, "constraints.gap")
    {'gap_low': -1 <= x - y, 'gap_high': x - y < 1}
    """
    if not isinstance(text, str):
        raise ExpressionError(f'{where}: expected text such as "x <= 1", got {text!r}')
    parts = SIGN.split(text)
    sides, signs = parts[::2], parts[1::2]
    if not 1 <= len(signs) <= 2 or "=" in "".join(sides):
        raise ExpressionError(
            f'{where}: {text[:LONGEST]!r} is no inequality; write it like "x**2 + y <= 1" or '
            '"-1 <= x <= 1", with <=, <, >= or > (an equality belongs into the map, q_0 or q_d)'
        )
    if len({sign[0] for sign in signs}) > 1:
        raise ExpressionError(
            f"{where}: {text[:LONGEST]!r} compares its middle with two bounds of the same side; "
            "write two inequalities"
        )
    formulas = [parse_expression(side, symbols, where) for side in sides]
    names = [name] if len(signs) == 1 else [row_name(name, side) for side in ("low", "high")]
    if signs[0][0] == ">":
        names.reverse()
    return {
        own: SIGNS[sign](left, right, evaluate=False)
        for own, sign, left, right in zip(names, signs, formulas, formulas[1:])
    }
