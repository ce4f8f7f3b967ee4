"""Function blocks: smooth curves y = g(x) with derivative and domain.

A formula is written once for every array library that has the elementary functions (NumPy, torch);
the library is an argument. Code generators without a specific line for a block read the formula as
a tree (`FunctionBlock.trees`). Compiled loops have a separate switch.

The derivative is given in two forms: `slope` as a number, for the Jacobian, and `derivative` as a
wiring rule, for the adjoint half of a cell, in which g'(x) must be built from blocks. A wiring rule
is a sum of terms (coefficient, factors). The factors ``"x"`` and ``"y"`` are the input and output
of the block; any other is a function block on ``"x"`` or on ``"y"``, written ``"cos(x)"``.
Derivatives that such a sum cannot express (atan, asin) are wired by the front end.
"""

from __future__ import annotations

import math
from collections.abc import Callable
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
"""Function blocks that a tree may apply, by what array libraries call them."""


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


class _Trace:
    """Array library of traced numbers."""

    def __getattr__(self, name: str) -> Callable[[Any], _Traced]:
        if name not in ELEMENTARY:
            raise AttributeError(f"{name!r} is none of {', '.join(ELEMENTARY)}")
        return lambda x: _applied(ELEMENTARY[name], x)


def _applied(operation: str, *operands: Any) -> _Traced:
    return _Traced((operation, *map(_tree, operands)))


def _tree(operand: Any) -> Tree:
    return operand.tree if isinstance(operand, _Traced) else float(operand)


def folded(tree: Tree, leaf: Callable[[str | float], str], node: Callable[..., str]) -> str:
    """Return the text of a tree, written from the leaves to the root.

    ``leaf`` gives the text of ``"x"``, ``"y"`` or a number. ``node`` gives the text of an operation
    from its name and the texts of its operands. Operations are ``add``, ``subtract``, ``multiply``,
    ``divide`` and the values of `ELEMENTARY`.

    Examples
    --------
    >>> value, slope = function_block("atan").trees
    >>> folded(slope, str, lambda name, *operands: f"{name}({', '.join(operands)})")
    'divide(1.0, add(1.0, multiply(x, x)))'
    """
    if not isinstance(tree, tuple):
        return leaf(tree)
    return node(tree[0], *(folded(part, leaf, node) for part in tree[1:]))


@dataclass(frozen=True, kw_only=True, eq=False)
class FunctionBlock:
    """Memoryless nonlinear block.

    Attributes
    ----------
    name : str
        Name in expressions, netlists and files.
    formula, slope_formula : callable
        y = formula(library, x) and dy/dx = slope_formula(library, x, y).
    derivative : tuple of (float, tuple of str), or None
        dy/dx as a sum of products of blocks, see the module docstring.
    domain : (float, float)
        Open interval of x in which the block is defined.
    has_pole : bool
        True if x = 0 is a pole inside the domain, so that x must not change its sign.
    """

    name: str
    formula: Callable[[Library, Any], Any]
    slope_formula: Callable[[Library, Any, Any], Any]
    derivative: tuple[tuple[float, tuple[str, ...]], ...] | None
    domain: tuple[float, float] = (-math.inf, math.inf)
    has_pole: bool = False

    def value(self, x: Any, library: Library = np) -> Any:
        """Return y = g(x) elementwise for library arrays of any (also complex) type."""
        return self.formula(library, x)

    def slope(self, x: Any, y: Any, library: Library = np) -> Any:
        """Return dy/dx at x for a known y = g(x)."""
        return self.slope_formula(library, x, y)

    @cached_property
    def trees(self) -> tuple[Tree, Tree]:
        """Value and slope as trees of sums, products, quotients and elementary functions.

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
    def is_limited(self) -> bool:
        """True if the block is undefined at some finite x."""
        return self.has_pole or self.domain != (-math.inf, math.inf)


FUNCTIONS: tuple[FunctionBlock, ...] = (
    FunctionBlock(
        name="sin",
        formula=lambda lib, x: lib.sin(x),
        slope_formula=lambda lib, x, y: lib.cos(x),
        derivative=((1.0, ("cos(x)",)),),
    ),
    FunctionBlock(
        name="cos",
        formula=lambda lib, x: lib.cos(x),
        slope_formula=lambda lib, x, y: -lib.sin(x),
        derivative=((-1.0, ("sin(x)",)),),
    ),
    FunctionBlock(
        name="tan",
        formula=lambda lib, x: lib.tan(x),
        slope_formula=lambda lib, x, y: 1 + y * y,
        derivative=((1.0, ()), (1.0, ("y", "y"))),
        domain=(-math.pi / 2, math.pi / 2),
    ),
    FunctionBlock(
        name="exp",
        formula=lambda lib, x: lib.exp(x),
        slope_formula=lambda lib, x, y: y,
        derivative=((1.0, ("y",)),),
    ),
    FunctionBlock(
        name="log",
        formula=lambda lib, x: lib.log(x),
        slope_formula=lambda lib, x, y: 1 / x,
        derivative=((1.0, ("reciprocal(x)",)),),
        domain=(0.0, math.inf),
    ),
    FunctionBlock(
        name="sqrt",
        formula=lambda lib, x: lib.sqrt(x),
        slope_formula=lambda lib, x, y: 0.5 / y,
        derivative=((0.5, ("reciprocal(y)",)),),
        domain=(0.0, math.inf),
    ),
    FunctionBlock(
        name="reciprocal",
        formula=lambda lib, x: 1 / x,
        slope_formula=lambda lib, x, y: -y * y,
        derivative=((-1.0, ("y", "y")),),
        has_pole=True,
    ),
    FunctionBlock(
        name="tanh",
        formula=lambda lib, x: lib.tanh(x),
        slope_formula=lambda lib, x, y: 1 - y * y,
        derivative=((1.0, ()), (-1.0, ("y", "y"))),
    ),
    FunctionBlock(
        name="sinh",
        formula=lambda lib, x: lib.sinh(x),
        slope_formula=lambda lib, x, y: lib.cosh(x),
        derivative=((1.0, ("cosh(x)",)),),
    ),
    FunctionBlock(
        name="cosh",
        formula=lambda lib, x: lib.cosh(x),
        slope_formula=lambda lib, x, y: lib.sinh(x),
        derivative=((1.0, ("sinh(x)",)),),
    ),
    FunctionBlock(
        name="atan",
        formula=lambda lib, x: lib.arctan(x),
        slope_formula=lambda lib, x, y: 1 / (1 + x * x),
        derivative=None,
    ),
    FunctionBlock(
        name="asin",
        formula=lambda lib, x: lib.arcsin(x),
        slope_formula=lambda lib, x, y: 1 / lib.sqrt(1 - x * x),
        derivative=None,
        domain=(-1.0, 1.0),
    ),
    FunctionBlock(
        name="acos",
        formula=lambda lib, x: lib.arccos(x),
        slope_formula=lambda lib, x, y: -1 / lib.sqrt(1 - x * x),
        derivative=None,
        domain=(-1.0, 1.0),
    ),
    FunctionBlock(
        name="rectify",
        formula=lambda lib, x: lib.where(lib.real(x) <= 0, 0.0, x),  # what is no number passes
        slope_formula=lambda lib, x, y: lib.where(lib.real(x) > 0, lib.ones_like(x), 0.0),
        derivative=None,
    ),
)
"""Function blocks; the position is the code that the compiled loops switch on."""

CODE = {block.name: code for code, block in enumerate(FUNCTIONS)}


@checked
def function_block(name: str) -> FunctionBlock:
    """Return the function block of a name, for instance ``"sin"``.

    Raises `UnknownNameError` with the existing names if the name is not in `FUNCTIONS`.

    Examples
    --------
    >>> function_block("tan").domain[1] == math.pi / 2
    True
    """
    if name not in CODE:
        raise UnknownNameError.of("function block", name, CODE)
    return FUNCTIONS[CODE[name]]
