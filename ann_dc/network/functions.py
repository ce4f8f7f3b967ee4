"""The function blocks: each a smooth curve y = g(x) with its derivative and its domain.

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

import numpy as np

from ann_dc.errors import UnknownNameError


@dataclass(frozen=True, kw_only=True, eq=False)
class FunctionBlock:
    """A memoryless nonlinear block.

    Attributes
    ----------
    name : str
        What expressions, netlists and files call it.
    value, slope : callable
        y = value(x) and dy/dx = slope(x, y), for NumPy arrays of any (also complex) type.
    derivative : tuple of (float, tuple of str), or None
        dy/dx as a sum of products of blocks, see the module docstring.
    domain : (float, float)
        Open interval of x in which the block is defined.
    """

    name: str
    value: Callable
    slope: Callable
    derivative: tuple[tuple[float, tuple[str, ...]], ...] | None
    domain: tuple[float, float] = (-math.inf, math.inf)


def _rectify(x):
    return np.where(np.real(x) > 0, x, 0)


def _step(x, y):
    return np.where(np.real(x) > 0, 1.0, 0.0)


FUNCTIONS: tuple[FunctionBlock, ...] = (
    FunctionBlock(
        name="sin", value=np.sin, slope=lambda x, y: np.cos(x), derivative=((1.0, ("cos(x)",)),)
    ),
    FunctionBlock(
        name="cos", value=np.cos, slope=lambda x, y: -np.sin(x), derivative=((-1.0, ("sin(x)",)),)
    ),
    FunctionBlock(
        name="tan",
        value=np.tan,
        slope=lambda x, y: 1 + y * y,
        derivative=((1.0, ()), (1.0, ("y", "y"))),
        domain=(-math.pi / 2, math.pi / 2),
    ),
    FunctionBlock(name="exp", value=np.exp, slope=lambda x, y: y, derivative=((1.0, ("y",)),)),
    FunctionBlock(
        name="log",
        value=np.log,
        slope=lambda x, y: 1 / x,
        derivative=((1.0, ("reciprocal(x)",)),),
        domain=(0.0, math.inf),
    ),
    FunctionBlock(
        name="sqrt",
        value=np.sqrt,
        slope=lambda x, y: 0.5 / y,
        derivative=((0.5, ("reciprocal(y)",)),),
        domain=(0.0, math.inf),
    ),
    FunctionBlock(
        name="reciprocal",
        value=lambda x: 1 / x,
        slope=lambda x, y: -y * y,
        derivative=((-1.0, ("y", "y")),),
    ),
    FunctionBlock(
        name="tanh",
        value=np.tanh,
        slope=lambda x, y: 1 - y * y,
        derivative=((1.0, ()), (-1.0, ("y", "y"))),
    ),
    FunctionBlock(
        name="sinh", value=np.sinh, slope=lambda x, y: np.cosh(x), derivative=((1.0, ("cosh(x)",)),)
    ),
    FunctionBlock(
        name="cosh", value=np.cosh, slope=lambda x, y: np.sinh(x), derivative=((1.0, ("sinh(x)",)),)
    ),
    FunctionBlock(
        name="atan", value=np.arctan, slope=lambda x, y: 1 / (1 + x * x), derivative=None
    ),
    FunctionBlock(
        name="asin",
        value=np.arcsin,
        slope=lambda x, y: 1 / np.sqrt(1 - x * x),
        derivative=None,
        domain=(-1.0, 1.0),
    ),
    FunctionBlock(
        name="acos",
        value=np.arccos,
        slope=lambda x, y: -1 / np.sqrt(1 - x * x),
        derivative=None,
        domain=(-1.0, 1.0),
    ),
    FunctionBlock(name="rectify", value=_rectify, slope=_step, derivative=None),
)
"""Every function block; its position is the code that the compiled kernel switches on."""

CODE = {block.name: code for code, block in enumerate(FUNCTIONS)}


def function_block(name: str) -> FunctionBlock:
    """Look a function block up by name.

    Examples
    --------
    >>> function_block("tan").domain[1] == math.pi / 2
    True
    """
    if name not in CODE:
        raise UnknownNameError.of("function block", name, CODE)
    return FUNCTIONS[CODE[name]]
