"""Vector code of function blocks: polynomials for sine and cosine, LLVM or libm.

The argument of a sine is reduced to within pi / 4 of a multiple of pi / 2. The multiple is
subtracted in three parts without loss of digits (Cody and Waite [1]_). The remainder is evaluated
with the polynomials of fdlibm [2]_. The reduction is valid up to `_LARGEST_ARGUMENT`; larger
arguments use libm, lane by lane. Function blocks are written from the trees of their formulas.

References
----------
.. [1] W. J. Cody, W. Waite, Software Manual for the Elementary Functions, 1980.
.. [2] fdlibm, ``k_sin.c`` and ``k_cos.c``, Sun Microsystems, 1993.
"""

from __future__ import annotations

import math
from typing import TypeAlias

from ann_dc.evaluation.codegen.writer import Function
from ann_dc.network.functions import FUNCTIONS, Tree

_LARGEST_ARGUMENT = 1e5
"""Largest argument of a sine, in radians, for the polynomials."""
_QUARTER_TURNS = (
    1.57079632673412561417,
    6.07710050630396597660e-11,
    2.02226624879595063154e-21,
)
"""Three parts of pi / 2; the last bits of the first two leave room for the multiple."""
_SINE = (
    -1.66666666666666324348e-01,
    8.33333333332248946124e-03,
    -1.98412698298579493134e-04,
    2.75573137070700676789e-06,
    -2.50507602534068634195e-08,
    1.58969099521155010221e-10,
)
_COSINE = (
    4.16666666666666019037e-02,
    -1.38888888888741095749e-03,
    2.48015872894767294178e-05,
    -2.75573143513906633035e-07,
    2.08757232129817482790e-09,
    -1.13596475577881948265e-11,
)
_ROUNDING = 1.5 * 2.0**52
"""Constant that, added to a number, leaves the nearest integer in the last bits."""
_LLVM = ("exp", "log", "sqrt")
"""Elementary operations that LLVM has; the others are functions of libm."""
_ARITHMETIC = {"add": "fadd", "subtract": "fsub", "multiply": "fmul", "divide": "fdiv"}
_COMPARISONS = {"at_most": "ole", "above": "ogt"}
CIRCULAR = ("sin", "cos", "tan")
"""Functions evaluated as polynomials: long chains of dependent instructions."""

_Circular: TypeAlias = dict[str, tuple[str, str]]
"""Pairs (sine, cosine) by argument."""


def function_of(f: Function, code: int, x: str, circular: _Circular) -> str:
    """Write a function block and return the name of its value.

    ``code`` is the code of the block on tapes and ``x`` the name of its argument, a vector.
    ``circular`` contains the computed (sine, cosine) pairs by argument; new pairs are added.
    """
    return _of_tree(f, FUNCTIONS[code].trees[0], {"x": x}, circular)


def slope_of(f: Function, code: int, x: str, y: str, circular: _Circular) -> str:
    """Write df/dx of a function block at ``x`` with value ``y`` and return its name.

    The other arguments are those of `function_of`.
    """
    return _of_tree(f, FUNCTIONS[code].trees[1], {"x": x, "y": y}, circular)


def _of_tree(f: Function, tree: Tree, given: dict[str, str], circular: _Circular) -> str:
    if not isinstance(tree, tuple):
        return given[tree] if isinstance(tree, str) else f.constant(tree)
    operation, *parts = tree
    of = lambda part: _of_tree(f, part, given, circular)  # noqa: E731
    match operation, parts:
        case "add", (a, ("multiply", b, c)):
            return f.fma(of(b), of(c), of(a))
        case "multiply", (-1.0, a):
            return f.op("fneg", of(a))
        case "where", ((comparison, a, b), c, d):
            return f.select(f.compare(_COMPARISONS[comparison], of(a), of(b)), of(c), of(d))
        case "maximum", (a, b):  # nan in a passes
            a, b = of(a), of(b)
            return f.select(f.compare("ole", a, b), b, a)
    if operation in _ARITHMETIC:
        return f.op(_ARITHMETIC[operation], *map(of, parts))
    return _elementary(f, operation, of(parts[0]), circular)


def _elementary(f: Function, name: str, x: str, circular: _Circular) -> str:
    if name in _LLVM:
        return f.call(name, x)
    if name not in CIRCULAR:
        return _lane_by_lane(f, name, x)
    if x not in circular:
        circular[x] = _sine_and_cosine(f, x)
    sine, cosine = circular[x]
    return {"sin": sine, "cos": cosine}.get(name) or f.op("fdiv", sine, cosine)


def _sine_and_cosine(f: Function, x: str) -> tuple[str, str]:
    """Write sine and cosine of a vector, to one or two units in the last place."""
    near = _near(f, x)
    far = f.compare("ogt", f.call("fabs", x), f.constant(_LARGEST_ARGUMENT))

    def from_libm() -> list[str]:
        """Write libm calls for large lanes only, so that lanes do not affect each other."""
        exact = _lane_by_lane(f, "sin", x), _lane_by_lane(f, "cos", x)
        return [f.select(far, slow, fast) for slow, fast in zip(exact, near)]

    sine, cosine = f.either(f.any_of(far), from_libm, near)
    return sine, cosine


def _lane_by_lane(f: Function, name: str, x: str) -> str:
    called = f.module.declare(name, "double", ["double"])
    out = "poison"
    for lane in range(f.width):
        y = f.value(f"call double {called}(double {f.lane(x, lane)})")
        out = f.with_lane(out, y, lane)
    return out


def _near(f: Function, x: str) -> tuple[str, str]:
    bits, integer = f"<{f.width} x i64>", lambda v: "<" + ", ".join([f"i64 {v}"] * f.width) + ">"
    shifted = f.fma(x, f.constant(2 / math.pi), f.constant(_ROUNDING))
    turns = f.op("fsub", shifted, f.constant(_ROUNDING))
    quarter = f.value(f"bitcast {f.vector} {shifted} to {bits}")
    r = x
    for part in _QUARTER_TURNS:
        r = f.fma(turns, f.constant(-part), r)
    z = f.op("fmul", r, r)
    sine = f.fma(f.op("fmul", _polynomial(f, _SINE, z), z), r, r)
    flat = f.fma(z, f.constant(-0.5), f.constant(1.0))
    cosine = f.fma(f.op("fmul", z, z), _polynomial(f, _COSINE, z), flat)
    odd = f.value(f"trunc {bits} {quarter} to <{f.width} x i1>")

    def signed(value: str, quarters: str) -> str:
        """Write a value with its sign inverted in the third and fourth quarter."""
        sign = f.value(f"shl {bits} {quarters}, {integer(62)}")
        sign = f.value(f"and {bits} {sign}, {integer(-(1 << 63))}")
        raw = f.value(f"bitcast {f.vector} {value} to {bits}")
        return f.value(f"bitcast {bits} {f.value(f'xor {bits} {raw}, {sign}')} to {f.vector}")

    following = f.value(f"add {bits} {quarter}, {integer(1)}")
    return (
        signed(f.select(odd, cosine, sine), quarter),
        signed(f.select(odd, sine, cosine), following),
    )


def _polynomial(f: Function, coefficients: tuple[float, ...], z: str) -> str:
    total = f.constant(coefficients[-1])
    for coefficient in coefficients[-2::-1]:
        total = f.fma(total, z, f.constant(coefficient))
    return total
