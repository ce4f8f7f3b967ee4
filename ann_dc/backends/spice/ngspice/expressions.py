"""Numbers of a netlist in SPICE notation: ``10k``, ``{r*(1+e)}``."""

from __future__ import annotations

import ast
import math
import operator
import re
from collections.abc import Callable, Mapping
from functools import lru_cache
from typing import Any

from ann_dc.errors import FileFormatError

SUFFIXES = {
    "t": 1e12,
    "g": 1e9,
    "meg": 1e6,
    "k": 1e3,
    "m": 1e-3,
    "u": 1e-6,
    "n": 1e-9,
    "p": 1e-12,
    "f": 1e-15,
}
"""Factors of the suffixes of a number."""

NUMBER = r"(?:\d+\.?\d*|\.\d+)(?:e[+-]?\d+)?"
PLAIN = re.compile(rf"([+-]?{NUMBER})(meg|[tgkmunpf])?[a-z]*")
SUFFIXED = re.compile(rf"(?<![\w.])({NUMBER})(meg|[tgkmunpf])(?!\w)")
LONGEST = 2000
"""Largest number of characters of an expression."""

OPERATORS: dict[type, Callable[..., Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: math.pow,
    ast.USub: operator.neg,
    ast.UAdd: operator.pos,
}
FUNCTIONS: dict[str, Callable[..., Any]] = {
    "abs": abs,
    "max": max,
    "min": min,
    "ln": math.log,
    "sqrt": math.sqrt,
}


def value_of(text: str, known: Mapping[str, float]) -> float:
    """Return the value of a number or an expression in braces on a card, in lower case.

    ``known`` contains the parameters that an expression can name. Raises `FileFormatError` if the
    text is neither, or names an unknown parameter.

    >>> value_of("{10k*(1+e)}", {"e": 0.5}), value_of("2.5meg", {})
    (15000.0, 2500000.0)
    """
    if not text.startswith("{"):
        found = PLAIN.fullmatch(text)
        if found is None:
            raise FileFormatError(f"netlist: {text[:60]!r} is not a number")
        return float(found[1]) * SUFFIXES.get(found[2], 1.0)
    try:
        return float(_value(_tree(text), known))
    except (ArithmeticError, LookupError, RecursionError, TypeError, ValueError) as error:
        raise FileFormatError(f"netlist: {text[:60]!r} has no value: {error}") from error


@lru_cache(maxsize=4096)
def _tree(text: str) -> ast.expr:
    if len(text) > LONGEST or not text.endswith("}"):
        raise ValueError("expected an expression in braces")
    plain = SUFFIXED.sub(lambda m: repr(float(m[1]) * SUFFIXES[m[2]]), text[1:-1])
    try:
        return ast.parse(plain.strip(), mode="eval").body
    except (SyntaxError, RecursionError, MemoryError) as error:
        raise ValueError(f"not an expression: {error}") from error


def _value(node: ast.expr, known: Mapping[str, float]) -> float:
    if isinstance(node, ast.Constant) and isinstance(node.value, (int, float)):
        return float(node.value)
    if isinstance(node, ast.Name):
        return known[node.id]
    if isinstance(node, ast.UnaryOp):
        return OPERATORS[type(node.op)](_value(node.operand, known))
    if isinstance(node, ast.BinOp):
        return OPERATORS[type(node.op)](_value(node.left, known), _value(node.right, known))
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and not node.keywords:
        return FUNCTIONS[node.func.id](*(_value(each, known) for each in node.args))
    raise ValueError("only numbers, names, sums, products, powers and five functions are read")
