r"""Function blocks as ONNX operations; in float64 only operations of onnxruntime.

In float64, onnxruntime has no tan, sinh, cosh, atan, asin and acos. The inverse functions are
computed in float32 and corrected once by an addition theorem, with s and c the sine and cosine of
the float32 value :math:`y_0`:

.. math:: \arctan x = y_0 + \arctan\frac{x c - s}{c + x s}, \qquad
    \arcsin x = y_0 + \arcsin(x c - r s), \quad r = \sqrt{1 - x^2},

where the correction is so small that two terms of its series are exact. Function blocks are written
from the trees of their formulas.
"""

from __future__ import annotations

import numpy as np

from ann_dc.export.onnx.graph import Graph
from ann_dc.network.functions import FunctionBlock, Tree, function_block

KINDS = {"add": "Add", "subtract": "Sub", "multiply": "Mul", "divide": "Div", "where": "Where"}
KINDS |= {"at_most": "LessOrEqual", "above": "Greater"}
"""ONNX operations of trees; those of elementary operations are capitalised: ``Sin``, ``Atan``."""
SMALL = 0.5
"""Bound on the argument below which the hyperbolic sine is computed from the hyperbolic tangent of
its
half.
"""

BELOW_RIGHT_ANGLE = 6.123233995736766e-17
"""Rounding remainder of pi / 2 in float64."""


def value(graph: Graph, function: str, x: str) -> str:
    """Return y = g(x) of a function block, element by element."""
    return _of_tree(graph, function_block(function).trees[0], x)


def _of_tree(graph: Graph, tree: Tree, x: str) -> str:
    if not isinstance(tree, tuple):
        return x if isinstance(tree, str) else graph.number(tree)
    operation, first = tree[0], tree[1]
    if operation == "divide" and first == 1.0:
        return graph.op("Reciprocal", _of_tree(graph, tree[2], x))
    given = [_of_tree(graph, part, x) for part in tree[1:]]
    if operation == "maximum":  # nan in the first operand passes
        a, b = given
        return graph.op("Where", graph.op("LessOrEqual", a, b), b, a)
    if operation in _COMPOSED and graph.dtype != np.float32:
        return _COMPOSED[operation](graph, *given)
    return graph.op(KINDS.get(operation) or operation.capitalize(), *given)


def inside(graph: Graph, block: FunctionBlock, x: str, side: str | None) -> str | None:
    """Return a number that is positive if the argument x is in the domain of a block.

    Returns None if the domain is unbounded. If the block has a pole, ``side`` is the required sign
    of the argument; None permits both signs.
    """
    if block.has_pole:
        return graph.op("Abs", x) if side is None else graph.op("Mul", x, side)
    low, high = block.domain
    if not block.is_limited:
        return None
    if low == -high:
        return graph.op("Sub", graph.number(high), graph.op("Abs", x))
    return x if low == 0.0 else graph.op("Sub", x, graph.number(low))


def side_of_pole(graph: Graph, x: str) -> str:
    """Return -1 for a negative argument, else 1."""
    negative = graph.op("Less", x, _zero(graph))
    return graph.op("Where", negative, graph.number(-1.0), graph.number(1.0))


def _zero(graph: Graph) -> str:
    return graph.number(0.0)


def _tan(graph: Graph, x: str) -> str:
    """Compute sin x / sin(pi/2 - |x|); a cosine would lose digits near the poles."""
    apart = graph.op("Sub", graph.number(np.pi / 2), graph.op("Abs", x))
    apart = graph.op("Add", apart, graph.number(BELOW_RIGHT_ANGLE))
    return graph.op("Div", graph.op("Sin", x), graph.op("Sin", apart))


def _exponentials(graph: Graph, kind: str, x: str) -> str:
    pair = graph.op("Exp", x), graph.op("Exp", graph.op("Neg", x))
    return graph.op("Mul", graph.number(0.5), graph.op(kind, *pair))


def _cosh(graph: Graph, x: str) -> str:
    return _exponentials(graph, "Add", x)


def _sinh(graph: Graph, x: str) -> str:
    """Compute 2 t / (1 - t^2) with t = tanh(x / 2) for small x.

    Exponentials would cancel there.
    """
    t = graph.op("Tanh", graph.op("Mul", graph.number(0.5), x))
    below = graph.op("Sub", graph.number(1.0), graph.op("Mul", t, t))
    near = graph.op("Div", graph.op("Add", t, t), below)
    is_small = graph.op("Less", graph.op("Abs", x), graph.number(SMALL))
    return graph.op("Where", is_small, near, _exponentials(graph, "Sub", x))


def _first(graph: Graph, kind: str, x: str) -> tuple[str, str, str]:
    """Return the value in float32, its sine, and its cosine."""
    from onnx import TensorProto

    single = graph.op(kind, graph.op("Cast", x, to=TensorProto.FLOAT))
    y = graph.op("Cast", single, to=TensorProto.DOUBLE)
    return y, graph.op("Sin", y), graph.op("Cos", y)


def _corrected(graph: Graph, y: str, small: str, third: float) -> str:
    """Compute y + small + third small^3."""
    square = graph.op("Mul", small, small)
    factor = graph.op("Mul", graph.number(third), square)
    return graph.op("Add", y, graph.op("Add", small, graph.op("Mul", factor, small)))


def _atan(graph: Graph, x: str) -> str:
    y, s, c = _first(graph, "Atan", x)
    above = graph.op("Sub", graph.op("Mul", x, c), s)
    below = graph.op("Add", c, graph.op("Mul", x, s))
    return _corrected(graph, y, graph.op("Div", above, below), -1 / 3)


def _root(graph: Graph, x: str) -> str:
    """Compute sqrt(1 - x^2), exact also near one."""
    one = graph.number(1.0)
    return graph.op("Sqrt", graph.op("Mul", graph.op("Sub", one, x), graph.op("Add", one, x)))


def _asin(graph: Graph, x: str) -> str:
    y, s, c = _first(graph, "Asin", x)
    along, across = graph.op("Mul", x, c), graph.op("Mul", _root(graph, x), s)
    return _corrected(graph, y, graph.op("Sub", along, across), 1 / 6)


def _acos(graph: Graph, x: str) -> str:
    y, s, c = _first(graph, "Acos", x)
    along, across = graph.op("Mul", _root(graph, x), c), graph.op("Mul", x, s)
    return _corrected(graph, y, graph.op("Sub", along, across), 1 / 6)


_COMPOSED = {
    "tan": _tan,
    "cosh": _cosh,
    "sinh": _sinh,
    "atan": _atan,
    "asin": _asin,
    "acos": _acos,
}
"""Operations that onnxruntime supports only in float32."""
