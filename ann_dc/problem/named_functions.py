"""Functions that formulas call by name: SymPy classes of the function blocks.

An elementary block has SymPy's class of the same name. Another block becomes a class that is
evaluated and differentiated by the trees of `ann_dc.network.functions`; it stays one function, so
that a network computes it with one block.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import sympy as sp

from ann_dc.errors import ProblemError
from ann_dc.network.functions import (
    ARITHMETIC,
    ELEMENTARY,
    FUNCTIONS as BLOCKS,
    FunctionBlock,
    folded,
    lacking,
)

IN_OTHER_WORDS: dict[str, Callable[[Any], Any]] = {
    "sec": lambda x: 1 / sp.cos(x),
    "csc": lambda x: 1 / sp.sin(x),
    "cot": lambda x: sp.cos(x) / sp.sin(x),
    "coth": lambda x: 1 / sp.tanh(x),
    "sech": lambda x: 1 / sp.cosh(x),
    "csch": lambda x: 1 / sp.sinh(x),
    "acosh": lambda x: sp.log(x + sp.sqrt(x**2 - 1)),
    "asinh": lambda x: sp.log(x + sp.sqrt(x**2 + 1)),
    "atanh": lambda x: sp.log((1 + x) / (1 - x)) / 2,
}
"""Functions of SymPy without a function block, expressed in functions that have one."""

_LIBRARY = ARITHMETIC | {name: getattr(sp, name) for name in ELEMENTARY.values()}


def _tree_value(block: FunctionBlock, place: int, given: dict[str, Any]) -> Any:
    """Return value (0) or slope (1) of a function block as a SymPy expression."""
    tree = block.trees[place]
    lacked = lacking(tree, _LIBRARY)
    if lacked:
        raise ProblemError(
            f"function {block.name!r} is not smooth: its formula has the operation {lacked!r}; "
            f"stationarity equations need {', '.join(_LIBRARY)}"
        )
    return folded(tree, given, _LIBRARY, _number)


def _number(value: float) -> sp.Expr:
    return sp.Integer(value) if value.is_integer() else sp.Float(value)


def _class_of(block: FunctionBlock) -> Any:
    """Return SymPy's class of an elementary block, or a new class of another one."""
    if block.is_elementary:
        return getattr(sp, block.name)

    def slope(self: Any, argindex: int = 1) -> Any:
        return _tree_value(block, 1, {"x": self.args[0], "y": self})

    def digits(self: Any, precision: int) -> Any:
        return _tree_value(block, 0, {"x": self.args[0]})._evalf(precision)

    own = {"nargs": 1, "fdiff": slope, "_eval_evalf": digits, "_imp_": staticmethod(block.value)}
    return type(block.name, (sp.Function,), {**own, "__module__": __name__})


FUNCTIONS: dict[str, Any] = {
    **{block.name: _class_of(block) for block in BLOCKS if block.in_expressions},
    **{name: getattr(sp, name) for name in IN_OTHER_WORDS},
}
"""Functions that an expression may call, each with one argument."""


def __getattr__(name: str) -> Any:
    """Return the class of a function, by which pickle finds it."""
    if name in FUNCTIONS:
        return FUNCTIONS[name]
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
