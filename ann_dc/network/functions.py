"""The function blocks: each a smooth curve y = g(x) with its derivative and its domain.

A formula is written once, for every array library that has the elementary functions (NumPy, torch):
it takes the library as an argument. Loops that are compiled have a switch of their own.

The derivative is given twice because it is needed twice: `slope` as a number, for the Jacobian,
and `derivative` as a wiring rule, for the adjoint half of a cell, where g'(x) has to be made of
blocks again. A wiring rule is a sum of terms (coefficient, factors); the factors ``"x"`` and
``"y"`` are the block's own input and output, any other is a function block on ``"x"`` or on ``"y"``
written ``"cos(x)"``. A rule that no such sum expresses (atan, asin) is rewritten by the front end.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from ann_dc.errors import UnknownNameError
from ann_dc.hints.checked import checked

Library: TypeAlias = Any
"""An array library: the module ``numpy`` or ``torch``."""


@dataclass(frozen=True, kw_only=True, eq=False)
class FunctionBlock:
    """A memoryless nonlinear block.

    Attributes
    ----------
    name : str
        What expressions, netlists and files call it.
    formula, slope_formula : callable
        y = formula(library, x) and dy/dx = slope_formula(library, x, y).
    derivative : tuple of (float, tuple of str), or None
        dy/dx as a sum of products of blocks, see the module docstring.
    domain : (float, float)
        Open interval of x in which the block is defined.
    has_pole : bool
        Whether x = 0 is a pole inside the domain, so that x has to stay on its side of it.
    """

    name: str
    formula: Callable[[Library, Any], Any]
    slope_formula: Callable[[Library, Any, Any], Any]
    derivative: tuple[tuple[float, tuple[str, ...]], ...] | None
    domain: tuple[float, float] = (-math.inf, math.inf)
    has_pole: bool = False

    def value(self, x: Any, library: Library = np) -> Any:
        """y = g(x), element by element, for arrays of the library of any (also complex) type."""
        return self.formula(library, x)

    def slope(self, x: Any, y: Any, library: Library = np) -> Any:
        """dy/dx at x, where y = g(x) is known."""
        return self.slope_formula(library, x, y)

    @property
    def is_limited(self) -> bool:
        """Whether there are finite x at which the block is not defined."""
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
"""Every function block; its position is the code that the compiled loops switch on."""

CODE = {block.name: code for code, block in enumerate(FUNCTIONS)}


@checked
def function_block(name: str) -> FunctionBlock:
    """Look a function block up by name.

    Parameters
    ----------
    name : str
        One of `FUNCTIONS`, for instance ``"sin"``.

    Returns
    -------
    FunctionBlock

    Raises
    ------
    UnknownNameError
        If there is none of that name; the message lists those that there are.

    Examples
    --------
    >>> function_block("tan").domain[1] == math.pi / 2
    True
    """
    if name not in CODE:
        raise UnknownNameError.of("function block", name, CODE)
    return FUNCTIONS[CODE[name]]
