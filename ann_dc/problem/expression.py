"""Mathematical expressions as text, parsed without evaluating the text as code.

A problem file contains, for example, ``"sin(phi) * nu - 0.1 * x"``. Python's grammar turns the text
into a syntax tree. A whitelist turns the tree into a SymPy expression and rejects other syntax by
name.

Every expression that a Python declaration accepts is read as the same expression. Sums and products
are each read as a whole; a minus before a product is one of its factors.

The text size is limited before parsing, and numbers are limited before they are computed. A hostile
file therefore costs no more time than an ordinary one.
"""

from __future__ import annotations

import ast
import itertools
import math
import re
import warnings
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import sympy as sp

from ann_dc.errors import ExpressionError
from ann_dc.problem.named_functions import FUNCTIONS

NON_SMOOTH_NAMES = frozenset(
    ("abs", "fabs", "max", "min", "clip", "relu", "sign", "sgn", "step", "heaviside")
).union(("floor", "ceil", "ceiling", "round", "mod", "piecewise"))
"""Common functions that lack a derivative at some point."""

MAX_CHARACTERS = 10_000
MAX_PARENTHESES = 100
MAX_TREE_DEPTH = 250
MAX_EXPONENT = 1000
MAX_MAGNITUDE = 1e300
MAX_BITS = 4000
"""Maximum number of bits of the numerator or the denominator of an exact number."""

_SIGNS: dict[type, int] = {ast.UAdd: 1, ast.USub: -1}
_SUM, _PRODUCT = (ast.Add, ast.Sub), (ast.Mult, ast.Div)


def parse_expression(text: str, symbols: Mapping[str, sp.Expr], where: str) -> sp.Expr:
    """Read a mathematical expression from text: numbers, names, + - * / **, calls of `FUNCTIONS`.

    A name is a symbol, a number (a parameter) or ``pi``. Raises `ExpressionError`, which begins
    with the field ``where``, with the rejected piece of text and the allowed syntax.

    Examples
    --------
    >>> theta, u = sp.symbols("theta u")
    >>> parse_expression("u - 4.905*sin(theta)", {"theta": theta, "u": u}, "dynamics.omega")
    u - 4.905*sin(theta)
    """
    source = _checked_text(text, where)
    return _Reader(source, symbols, where).read(_syntax_tree(source, where))


def _checked_text(text: str, where: str) -> str:
    """Return the text with joined lines; reject text that is too large or not plain."""
    if not isinstance(text, str):
        raise ExpressionError(f'{where}: expected text such as "2*sin(x)", got {text!r}')
    if len(text) > MAX_CHARACTERS:
        raise ExpressionError(
            f"{where}: {_short(text)!r} has {len(text)} characters; at most {MAX_CHARACTERS} are "
            "allowed, so split the problem or declare it in Python"
        )
    source = " ".join(text.split())
    if not source:
        raise ExpressionError(f"{where}: the text is empty; write an expression, or 0")
    odd = re.search(r"[^A-Za-z0-9_.,()+*/ -]", source)
    if odd:
        raise ExpressionError(
            f"{where}: {odd.group()!r} in {_short(source)!r} is not allowed; an expression has "
            "letters, digits, parentheses and + - * / ** (a power is written x**2)"
        )
    if _parenthesis_depth(source) > MAX_PARENTHESES:
        raise ExpressionError(
            f"{where}: {_short(source)!r} nests more than {MAX_PARENTHESES} parentheses; "
            "write it with fewer"
        )
    return source


def _parenthesis_depth(source: str) -> int:
    steps = ((character == "(") - (character == ")") for character in source)
    return max(itertools.accumulate(steps))


def _syntax_tree(source: str, where: str) -> ast.expr:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # "1if x" is refused below, no need to warn as well
            tree = ast.parse(source, mode="eval").body
    except (RecursionError, MemoryError) as error:
        raise _too_deep(source, where) from error
    except (SyntaxError, ValueError) as error:
        reason = getattr(error, "msg", None) or str(error)
        raise ExpressionError(
            f"{where}: {_short(source)!r} is not an expression ({reason}); "
            "write it like 2*x**2 + sin(y)"
        ) from error
    if sum(1 for _ in _levels(tree)) > MAX_TREE_DEPTH:
        raise _too_deep(source, where)
    return tree


def _levels(tree: ast.AST) -> Iterator[list[ast.AST]]:
    """Yield the nodes of a syntax tree by level; a whole sum or product is one level."""
    level = [tree]
    while level:
        yield level
        level = [child for node in level for child in _operands(node)]


def _operands(node: ast.AST) -> Iterator[ast.AST]:
    chain = next((c for c in (_SUM, _PRODUCT) if _is_binary(node, c)), None)
    if chain is None:
        yield from ast.iter_child_nodes(node)
    else:
        yield from (operand for _, operand in _chained(node, chain))


def _is_binary(node: ast.AST, operators: tuple[type[ast.operator], ...]) -> bool:
    return isinstance(node, ast.BinOp) and isinstance(node.op, operators)


def _chained(node: Any, operators: tuple) -> list[tuple[ast.operator | None, ast.expr]]:
    """Return the operands of a sum or product in order, each with its operator."""
    found: list[tuple[ast.operator | None, ast.expr]] = []
    while _is_binary(node, operators):
        found.append((node.op, node.right))
        node = node.left
    return [(None, node), *reversed(found)]


def _too_deep(source: str, where: str) -> ExpressionError:
    return ExpressionError(
        f"{where}: {_short(source)!r} nests more than {MAX_TREE_DEPTH} operations, or chains some "
        "thousand; write it in parts, or declare the problem in Python"
    )


def _short(text: str, length: int = 60) -> str:
    return text if len(text) <= length else text[:length] + "..."


@dataclass(frozen=True)
class _Reader:
    """Converter of the syntax tree of one source text into a SymPy expression."""

    source: str
    symbols: Mapping[str, sp.Expr]
    where: str

    def read(self, node: ast.expr) -> sp.Expr:
        match node:
            case ast.Constant(value=value):
                result = self._number(node, value)
            case ast.Name(id=name):
                return self._name(node, name)
            case ast.UnaryOp(op=ast.UAdd() | ast.USub() as op, operand=operand):
                result = _SIGNS[type(op)] * self.read(operand)
            case ast.BinOp(op=ast.Add() | ast.Sub()):
                result = self._sum(node)
            case ast.BinOp(op=ast.Mult() | ast.Div()):
                result = self._product(node)
            case ast.BinOp(left=left, op=ast.Pow(), right=right):
                result = self._power(node, self.read(left), self.read(right))
            case ast.Call(func=ast.Name(id=name), args=arguments, keywords=keywords):
                result = self._call(node, name, [*arguments, *keywords])
            case _:
                raise self._refused(node, f"is {_described(node)}, which is not allowed")
        return self._bounded(node, result)

    def _number(self, node: ast.expr, value: object) -> sp.Expr:
        if type(value) is int:
            return sp.Integer(value)
        if type(value) is float:
            return sp.Float(value)
        raise self._refused(node, "is not a real number")

    def _name(self, node: ast.expr, name: str) -> sp.Expr:
        if name == "pi":
            return sp.pi
        if name in self.symbols:
            return self.symbols[name]
        if name in FUNCTIONS:
            raise self._refused(node, f"is a function; call it, as in {name}(x)")
        raise self._refused(node, "is not a name of this problem")

    def _sum(self, node: ast.expr) -> sp.Expr:
        terms = [(op, self.read(term)) for op, term in _chained(node, _SUM)]
        return sp.Add(*(-term if isinstance(op, ast.Sub) else term for op, term in terms))

    def _product(self, node: ast.expr) -> sp.Expr:
        return sp.Mul(*self._factors(node, inverse=False))

    def _factors(self, node: ast.expr, *, inverse: bool) -> Iterator[sp.Expr]:
        """Yield the factors of a product, including a minus; each of a divisor separately."""
        while isinstance(node, ast.UnaryOp) and type(node.op) in _SIGNS:
            yield sp.Integer(_SIGNS[type(node.op)])
            node = node.operand
        if not _is_binary(node, _PRODUCT):
            yield self._inverse(node, self.read(node)) if inverse else self.read(node)
            return
        for op, operand in _chained(node, _PRODUCT):
            yield from self._factors(operand, inverse=inverse != isinstance(op, ast.Div))

    def _inverse(self, node: ast.expr, divisor: sp.Expr) -> sp.Expr:
        if divisor == 0:  # is_zero may take seconds to find out, and leaves little more
            raise self._refused(node, "divides by zero")
        return divisor**-1

    def _power(self, node: ast.expr, base: sp.Expr, exponent: sp.Expr) -> sp.Expr:
        if base == 0 and not (exponent.is_number and _value(exponent) > 0):
            raise self._refused(node, "divides by zero")
        self._check_power(node, base, exponent)
        power = base**exponent
        self._check_exponent(node, power.as_base_exp()[1])  # (x**900)**900 is x**810000
        return power

    def _check_power(self, node: ast.expr, base: sp.Expr, exponent: sp.Expr) -> None:
        """Reject a power that is too long, before the number is computed."""
        if not exponent.is_number:
            return
        self._check_exponent(node, exponent)
        symbols = base.free_symbols
        number = base.as_independent(*symbols, as_Add=False)[0] if symbols else base
        size, times = abs(_value(number)), abs(_value(exponent))
        if size and not times * abs(math.log10(size)) <= math.log10(MAX_MAGNITUDE):
            raise self._too_large(node)
        if number.is_Rational and times * max(_bits(number), 1) > MAX_BITS * 4:
            raise self._too_long(node)

    def _call(self, node: ast.expr, name: str, arguments: list) -> sp.Expr:
        if name.lower() in NON_SMOOTH_NAMES:
            raise self._refused(
                node,
                f"calls {name}, which is not smooth: the stationarity equations need a "
                "derivative everywhere, so use a smooth approximation such as sqrt(x**2 + "
                "0.01) for |x|",
            )
        if name not in FUNCTIONS:
            raise self._refused(node, f"calls {name}, which is not a known function")
        if len(arguments) != 1 or not isinstance(arguments[0], ast.expr):
            raise self._refused(node, f"must give {name} exactly one plain argument")
        argument = self.read(arguments[0])
        if name == "exp":
            self._check_exponential(node, argument)
        return FUNCTIONS[name](argument)

    def _check_exponential(self, node: ast.expr, argument: sp.Expr) -> None:
        # SymPy turns exp(c*log(b)) into b**c at once, so c is an exponent like any other.
        for term in sp.Add.make_args(argument):
            factors = sp.Mul.make_args(term)
            for log in (factor for factor in factors if isinstance(factor, sp.log)):
                rest = sp.Mul(*(factor for factor in factors if factor is not log))
                self._check_power(node, log.args[0], rest)

    def _check_exponent(self, node: ast.expr, exponent: sp.Expr) -> None:
        if exponent.is_number and not abs(_value(exponent)) <= MAX_EXPONENT:
            raise self._refused(
                node, f"has an exponent outside -{MAX_EXPONENT} to {MAX_EXPONENT}; scale the units"
            )

    def _bounded(self, node: ast.expr, result: sp.Expr) -> sp.Expr:
        """Reject a constant or constant factor that is not a real number of ordinary size."""
        number = result if result.is_number else result.as_coeff_Mul()[0]
        if number.is_Rational and _bits(number) > MAX_BITS:
            raise self._too_long(node)
        value = _value(number)
        if math.isnan(value):
            raise self._refused(node, "is not a finite real number")
        if value and not 1 / MAX_MAGNITUDE <= abs(value) <= MAX_MAGNITUDE:
            raise self._too_large(node)
        return result

    def _too_large(self, node: ast.AST) -> ExpressionError:
        return self._refused(
            node,
            f"has a magnitude outside {1 / MAX_MAGNITUDE:g} to {MAX_MAGNITUDE:g}; scale the units",
        )

    def _too_long(self, node: ast.AST) -> ExpressionError:
        return self._refused(node, "is an exact number of too many digits; write it with a point")

    def _refused(self, node: ast.AST, reason: str) -> ExpressionError:
        piece = ast.get_source_segment(self.source, node) or self.source
        return ExpressionError(
            f"{self.where}: {_short(piece)!r} {reason}. Allowed: numbers, pi, + - * / **, "
            f"parentheses, the names {', '.join(self.symbols) or '(none)'}, "
            f"and the functions {', '.join(FUNCTIONS)}"
        )


def _bits(number: Any) -> int:
    return max(int(number.p).bit_length(), int(number.q).bit_length())


def _value(number: sp.Expr) -> float:
    """Return the number as a float, nan if it is not real."""
    try:
        value = complex(number)
    except OverflowError:
        return math.inf
    except (TypeError, ValueError):
        return math.nan
    return math.nan if abs(value.imag) > 1e-12 * abs(value) else value.real


def _described(node: ast.AST) -> str:
    """Return the name of a rejected piece of syntax, for instance "an attribute"."""
    kinds = {
        ast.Attribute: "an attribute",
        ast.IfExp: "a conditional",
        ast.Call: "a call of an object that is not a name",
        ast.BoolOp: "a logical operation",
        ast.Tuple: "a list of values",
        ast.BinOp: "an operation",
        ast.UnaryOp: "an operation",
    }
    return kinds.get(type(node), f"Python syntax ({type(node).__name__})")
