"""Serialisation of SymPy expressions as text that `parse_expression` reads.

An expression becomes a few lines. A part that would make a line too long or too deep becomes a
separate line. Later lines refer to this line by a name that no symbol can have, such as ``_1``.
Sums and products are written in halves, so that lines do not nest deeply. A number retains all its
digits.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import sympy as sp

from ann_dc.errors import ExpressionError
from ann_dc.problem.expression import MAX_CHARACTERS, parse_expression
from ann_dc.problem.named_functions import FUNCTIONS, IN_OTHER_WORDS

LONGEST_PART = MAX_CHARACTERS // 8
"""Length in characters from which a part of an expression becomes a separate line."""
DEEPEST_PART = 20
"""Depth of nested parentheses from which a part becomes a separate line."""


def lines_of(expression: sp.Expr) -> tuple[str, ...]:
    """Return an expression as lines of text, the last of which is its value.

    A small expression is one line. Raises `ExpressionError` if the parser does not know a function.

    Examples
    --------
    >>> x, y = sp.symbols("x y")
    >>> lines_of(0.1 - x * sp.sin(y))
    ('0.1-x*sin(y)',)
    """
    writer = _Writer()
    last = writer.write(expression)
    return (*writer.lines, last)


def expression_of(lines: Sequence[str], symbols: Mapping[str, sp.Expr], where: str) -> sp.Expr:
    """Return the expression that lines written by `lines_of` represent.

    Raises `ExpressionError`, which begins with the field ``where``, if there is no line, or if a
    line is not an expression.
    """
    if not lines:
        raise ExpressionError(f"{where}: no line of text; write an expression, or 0")
    known = dict(symbols)
    value = sp.S.Zero
    for number, line in enumerate(lines, 1):
        value = parse_expression(line, known, where)
        known[f"_{number}"] = value
    return value


class _Writer:
    """Writer of one expression; parts that are too large become separate lines."""

    def __init__(self) -> None:
        self.lines: list[str] = []

    def write(self, expression: Any) -> str:
        text = self._text(expression)
        if len(text) > LONGEST_PART or _depth(text) > DEEPEST_PART:
            self.lines.append(text)
            return f"_{len(self.lines)}"
        return text

    def _text(self, expression: Any) -> str:
        if expression.is_Symbol:
            return expression.name
        if expression.is_number and not expression.args:
            return _number(expression)
        if expression.is_Add:
            return self._halves(expression.args, "+")
        if expression.is_Mul:
            return self._product(expression)
        if expression.is_Pow:
            return self._power(*expression.args)
        return self._call(expression)

    def _halves(self, parts: Sequence[Any], sign: str) -> str:
        """Return a sum or product, with the halves of a long one in parentheses."""
        if len(parts) > 4:
            middle = len(parts) // 2
            halves = self._halves(parts[:middle], sign), self._halves(parts[middle:], sign)
            return sign.join(f"({self._in_line(half)})" for half in halves)
        texts = [self.write(part) if sign == "+" else self._factor(part) for part in parts]
        return sign.join(texts).replace("+-", "-")

    def _in_line(self, text: str) -> str:
        """Return the text, or the name of a new line that contains the text."""
        if len(text) <= LONGEST_PART and _depth(text) <= DEEPEST_PART:
            return text
        self.lines.append(text)
        return f"_{len(self.lines)}"

    def _product(self, product: Any) -> str:
        """Return a product with the number first, so that 2*(x*(y + 1)) is not expanded."""
        number, rest = product.as_coeff_Mul()
        is_exact = not number.is_Float
        if is_exact and number == 1:
            return self._halves(product.args, "*")
        factors = rest.args if rest.is_Mul else (rest,)
        together = self._halves(factors, "*")
        if len(factors) > 1 and any(part.is_Add for part in factors):
            together = f"({together})"
        if is_exact and number == -1:
            return f"-{together}"
        return f"{self._factor(number)}*{together}"

    def _factor(self, part: Any) -> str:
        text = self.write(part)
        plain = text.isidentifier() or text.replace(".", "").isdigit()
        bare = plain or part.is_Function or (part.is_Pow and not text.startswith("1/"))
        return text if bare else f"({text})"

    def _power(self, base: Any, exponent: Any) -> str:
        if not exponent.is_number:
            return f"exp({self.write(exponent * sp.log(base))})"
        if exponent == sp.S.Half:
            return f"sqrt({self.write(base)})"
        below = f"({self.write(base)})" if base.is_Pow or base.is_number else self._factor(base)
        if exponent == -1:
            return f"1/{below}"
        above = self.write(exponent)
        return f"{below}**{above if above.isdigit() else f'({above})'}"

    def _call(self, call: Any) -> str:
        name = type(call).__name__
        if len(call.args) == 1 and name in FUNCTIONS:
            return f"{name}({self.write(call.args[0])})"
        if len(call.args) == 1 and name in IN_OTHER_WORDS:
            return self._text(IN_OTHER_WORDS[name](call.args[0]))
        raise ExpressionError(
            f"{call}: cannot be written as text that is read back; write it with one of "
            f"{', '.join(FUNCTIONS)} or with sums, products and powers"
        )


def _number(number: Any) -> str:
    """Return a number with all its digits."""
    if number.is_Integer:
        return str(number)
    if number.is_Rational:
        return f"{number.p}/{number.q}"
    if number is sp.pi:
        return "pi"
    if number is sp.E:
        return "exp(1)"
    return repr(float(number))


def _depth(text: str) -> int:
    deepest = depth = 0
    for character in text:
        depth += (character == "(") - (character == ")")
        deepest = max(deepest, depth)
    return deepest
