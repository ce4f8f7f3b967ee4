"""Function blocks: one record per curve y = g(x), read by every realisation.

A formula is written once for every array library that has the elementary functions (NumPy, torch);
the library is an argument. Traced with a library that records operations, a formula becomes a tree
(`FunctionBlock.trees`). Compiled loops, generated code, ONNX, LaTeX, Verilog-A, SymPy and CasADi
read this tree, and the adjoint half of a cell is wired from the tree of the slope. A realisation
knows only the operations of trees, never the names of function blocks. It refuses a block by name
if the tree contains an operation that it does not have.

A new block is a record in `FUNCTIONS` and, for circuits, a subcircuit ``func_<name>`` in
``circuits/models/ideal/func.lib`` and ``circuits/models/macro/func.lib``.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Container, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np

from ann_dc.errors import NetworkError, UnknownNameError
from ann_dc.validation import checked

Library: TypeAlias = Any
"""Array library: the module ``numpy`` or ``torch``."""
Tree: TypeAlias = "str | float | tuple[Any, ...]"
"""Formula: ``"x"``, ``"y"``, a number, or an operation with its operands."""
ELEMENTARY = {
    name: name for name in ["sin", "cos", "tan", "exp", "log", "sqrt", "tanh", "sinh", "cosh"]
}
ELEMENTARY |= {"arctan": "atan", "arcsin": "asin", "arccos": "acos"}
"""Elementary operations of trees, by the names that array libraries give them. C, LLVM, SymPy and
CasADi use the names of the operations.
"""
ARITHMETIC: dict[str, Callable[[Any, Any], Any]] = {
    "add": operator.add,
    "subtract": operator.sub,
    "multiply": operator.mul,
    "divide": operator.truediv,
}
CHOICES = ("maximum", "where", "at_most", "above")
"""Operations max(a, b), in which nan in a passes, ``where(condition, a, b)``, a <= b and a > b."""
OPERATIONS = (*ARITHMETIC, *CHOICES, *ELEMENTARY.values())
"""All operations of trees."""
INFIX = {"add": "{} + {}", "subtract": "{} - {}", "multiply": "{} * {}", "divide": "{} / {}"}
INFIX |= {"at_most": "{} <= {}", "above": "{} > {}"}
"""Forms of infix operators in most languages; see `written`."""
NUMPY = INFIX | {operation: f"np.{name}({{}})" for name, operation in ELEMENTARY.items()}
NUMPY |= {"maximum": "np.maximum({}, {})", "where": "np.where({}, {}, {})"}
"""Forms of all operations in NumPy."""


@dataclass(frozen=True, eq=False)
class _Traced:
    """Number that records the operations that produced its value."""

    tree: Tree

    def __add__(self, other: Any) -> _Traced:
        return _applied("add", self, other)

    def __radd__(self, other: Any) -> _Traced:
        return _applied("add", other, self)

    def __sub__(self, other: Any) -> _Traced:
        return _applied("subtract", self, other)

    def __rsub__(self, other: Any) -> _Traced:
        return _applied("subtract", other, self)

    def __mul__(self, other: Any) -> _Traced:
        return _applied("multiply", self, other)

    def __rmul__(self, other: Any) -> _Traced:
        return _applied("multiply", other, self)

    def __truediv__(self, other: Any) -> _Traced:
        return _applied("divide", self, other)

    def __rtruediv__(self, other: Any) -> _Traced:
        return _applied("divide", other, self)

    def __neg__(self) -> _Traced:
        return _applied("multiply", -1.0, self)

    def __le__(self, other: Any) -> _Condition:
        return _Condition(("at_most", self.tree, _tree(other)))

    def __gt__(self, other: Any) -> _Condition:
        return _Condition(("above", self.tree, _tree(other)))


@dataclass(frozen=True, eq=False)
class _Condition:
    """Comparison of traced numbers, which has no use but in a choice."""

    tree: Tree


class _Trace:
    """Array library of traced numbers, all of which are real."""

    @staticmethod
    def real(x: _Traced) -> _Traced:
        return x

    @staticmethod
    def ones_like(x: _Traced) -> float:
        return 1.0

    @staticmethod
    def where(condition: _Condition, a: Any, b: Any) -> _Traced:
        """Record a choice; ``where(b <= a, a, b)`` is a maximum in which nan in b passes."""
        if condition.tree == ("at_most", _tree(b), _tree(a)):
            return _applied("maximum", b, a)
        return _Traced(("where", condition.tree, _tree(a), _tree(b)))

    def __getattr__(self, name: str) -> Callable[[Any], _Traced]:
        if name not in ELEMENTARY:
            raise AttributeError(f"{name!r} is not one of {', '.join(ELEMENTARY)}, where")
        return lambda x: _applied(ELEMENTARY[name], x)


def _applied(operation: str, *operands: Any) -> _Traced:
    return _Traced((operation, *map(_tree, operands)))


def _tree(operand: Any) -> Tree:
    return operand.tree if isinstance(operand, _Traced) else float(operand)


def folded(
    tree: Tree,
    given: Mapping[str, Any],
    library: Mapping[str, Callable],
    number: Callable[[float], Any] = float,
) -> Any:
    """Return the value of a tree, computed from the leaves to the root.

    ``given`` has the meaning of ``"x"`` and ``"y"``, ``library`` a function per operation, and
    ``number`` converts numbers.
    """
    if not isinstance(tree, tuple):
        return given[tree] if isinstance(tree, str) else number(tree)
    return library[tree[0]](*(folded(part, given, library, number) for part in tree[1:]))


def lacking(tree: Tree, known: Container[str]) -> str | None:
    """Return the first operation of a tree that is not among the known ones, or None."""
    if not isinstance(tree, tuple):
        return None
    found = None if tree[0] in known else tree[0]
    return found or next(filter(None, (lacking(part, known) for part in tree[1:])), None)


def written(
    tree: Tree, given: Mapping[str, str], forms: Mapping[str, str], number: Callable = repr
) -> str:
    """Return the text of a tree in a language with infix operators.

    ``given`` has the texts of ``"x"`` and ``"y"``, ``forms`` a format string per operation, and
    ``number`` writes a number. A form that begins with ``{}`` is an infix operator, whose operands
    are enclosed in parentheses if they are infix operations themselves.
    """
    if not isinstance(tree, tuple):
        return given[tree] if isinstance(tree, str) else number(tree)
    is_infix = lambda part: isinstance(part, tuple) and forms[part[0]].startswith("{}")  # noqa: E731
    texts = []
    for part in tree[1:]:
        text = written(part, given, forms, number)
        texts.append(f"({text})" if is_infix(tree) and is_infix(part) else text)
    return forms[tree[0]].format(*texts)


@dataclass(frozen=True, kw_only=True, eq=False)
class FunctionBlock:
    """Memoryless nonlinear block.

    Attributes
    ----------
    name : str
        Name in expressions, netlists and files.
    formula, slope_formula : callable
        y = formula(library, x) and dy/dx = slope_formula(library, x, y).
    domain : (float, float)
        Open interval of x in which the block is defined.
    has_pole : bool
        True if x = 0 is a pole inside the domain, so that x must not change its sign.
    in_expressions : bool
        True if formulas of a problem call the block by its name, which is then reserved.
    """

    name: str
    formula: Callable[[Library, Any], Any]
    slope_formula: Callable[[Library, Any, Any], Any]
    domain: tuple[float, float] = (-math.inf, math.inf)
    has_pole: bool = False
    in_expressions: bool = True

    def value(self, x: Any, library: Library = np) -> Any:
        """Return y = g(x) elementwise for library arrays of any (also complex) type."""
        return self.formula(library, x)

    def slope(self, x: Any, y: Any, library: Library = np) -> Any:
        """Return dy/dx at x for a known y = g(x)."""
        return self.slope_formula(library, x, y)

    @cached_property
    def trees(self) -> tuple[Tree, Tree]:
        """Value and slope as trees of `OPERATIONS`.

        Raises `NetworkError` with the name of the function block if a formula uses other
        operations.
        """
        x, y, library = _Traced("x"), _Traced("y"), _Trace()
        try:
            return _tree(self.formula(library, x)), _tree(self.slope_formula(library, x, y))
        except (AttributeError, TypeError, ValueError) as error:
            raise NetworkError(
                f"function block {self.name!r}: its formula cannot be written as code: {error}"
            ) from error

    @property
    def is_elementary(self) -> bool:
        """True if the block is an operation of trees itself."""
        return self.name in ELEMENTARY.values()

    @property
    def is_limited(self) -> bool:
        """True if the block is undefined at some finite x."""
        return self.has_pole or self.domain != (-math.inf, math.inf)


def _sign(lib: Library, x: Any, at_zero: Any) -> Any:
    """Return 1 for x > 0, -1 for x < 0, and ``at_zero`` for zero and nan."""
    one, real = lib.ones_like(x), lib.real(x)
    return lib.where(real > 0, one, lib.where(-real > 0, -one, at_zero))


FUNCTIONS: tuple[FunctionBlock, ...] = (
    FunctionBlock(
        name="sin",
        formula=lambda lib, x: lib.sin(x),
        slope_formula=lambda lib, x, y: lib.cos(x),
    ),
    FunctionBlock(
        name="cos",
        formula=lambda lib, x: lib.cos(x),
        slope_formula=lambda lib, x, y: -lib.sin(x),
    ),
    FunctionBlock(
        name="tan",
        formula=lambda lib, x: lib.tan(x),
        slope_formula=lambda lib, x, y: 1 + y * y,
        domain=(-math.pi / 2, math.pi / 2),
    ),
    FunctionBlock(
        name="exp",
        formula=lambda lib, x: lib.exp(x),
        slope_formula=lambda lib, x, y: y,
    ),
    FunctionBlock(
        name="log",
        formula=lambda lib, x: lib.log(x),
        slope_formula=lambda lib, x, y: 1 / x,
        domain=(0.0, math.inf),
    ),
    FunctionBlock(
        name="sqrt",
        formula=lambda lib, x: lib.sqrt(x),
        slope_formula=lambda lib, x, y: 0.5 / y,
        domain=(0.0, math.inf),
    ),
    FunctionBlock(
        name="reciprocal",
        formula=lambda lib, x: 1 / x,
        slope_formula=lambda lib, x, y: -y * y,
        has_pole=True,
        in_expressions=False,
    ),
    FunctionBlock(
        name="tanh",
        formula=lambda lib, x: lib.tanh(x),
        slope_formula=lambda lib, x, y: 1 - y * y,
    ),
    FunctionBlock(
        name="sinh",
        formula=lambda lib, x: lib.sinh(x),
        slope_formula=lambda lib, x, y: lib.cosh(x),
    ),
    FunctionBlock(
        name="cosh",
        formula=lambda lib, x: lib.cosh(x),
        slope_formula=lambda lib, x, y: lib.sinh(x),
    ),
    FunctionBlock(
        name="atan",
        formula=lambda lib, x: lib.arctan(x),
        slope_formula=lambda lib, x, y: 1 / (1 + x * x),
    ),
    FunctionBlock(
        name="asin",
        formula=lambda lib, x: lib.arcsin(x),
        slope_formula=lambda lib, x, y: 1 / lib.sqrt(1 - x * x),
        domain=(-1.0, 1.0),
    ),
    FunctionBlock(
        name="acos",
        formula=lambda lib, x: lib.arccos(x),
        slope_formula=lambda lib, x, y: -1 / lib.sqrt(1 - x * x),
        domain=(-1.0, 1.0),
    ),
    FunctionBlock(
        name="rectify",
        formula=lambda lib, x: lib.where(lib.real(x) <= 0, 0.0, x),  # what is no number passes
        slope_formula=lambda lib, x, y: lib.where(lib.real(x) > 0, lib.ones_like(x), 0.0),
        in_expressions=False,
    ),
    FunctionBlock(
        name="abs",
        formula=lambda lib, x: lib.where(lib.real(x) <= -lib.real(x), -x, x),
        slope_formula=lambda lib, x, y: _sign(lib, x, 0.0),
        in_expressions=False,
    ),
    FunctionBlock(
        name="sigmoid",
        formula=lambda lib, x: 0.5 + 0.5 * lib.tanh(0.5 * x),  # exp(-x) would overflow
        slope_formula=lambda lib, x, y: y * (1 - y),
    ),
    FunctionBlock(
        name="sign",
        formula=lambda lib, x: _sign(lib, x, 0.0 * x),  # what is no number passes
        slope_formula=lambda lib, x, y: 0.0 * lib.ones_like(x),
        in_expressions=False,
    ),
)
"""Function blocks; the position is the code on tapes and in compiled loops."""

CODE = {block.name: code for code, block in enumerate(FUNCTIONS)}


@checked
def function_block(name: str) -> FunctionBlock:
    """Return the function block of a name, for instance ``"sin"``.

    Raises `UnknownNameError` with the existing names if the name is not in `FUNCTIONS`.
    """
    if name not in CODE:
        raise UnknownNameError.of("function block", name, CODE)
    return FUNCTIONS[CODE[name]]
