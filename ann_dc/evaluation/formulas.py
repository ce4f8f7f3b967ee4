"""Compiled formulas of all function blocks, and compiler settings of the package.

`ann_dc.network.functions` has the same formulas for array libraries. The conformance tests of the
evaluators check that both agree.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numba as nb
import numpy as np

from ann_dc.errors import NetworkError
from ann_dc.jit_functions import callback, kept
from ann_dc.network.functions import CODE, FUNCTIONS

_SIN = CODE["sin"]
_COS = CODE["cos"]
_TAN = CODE["tan"]
_EXP = CODE["exp"]
_LOG = CODE["log"]
_SQRT = CODE["sqrt"]
_RECIPROCAL = CODE["reciprocal"]
_TANH = CODE["tanh"]
_SINH = CODE["sinh"]
_COSH = CODE["cosh"]
_ATAN = CODE["atan"]
_ASIN = CODE["asin"]
_ACOS = CODE["acos"]
_RECTIFY = CODE["rectify"]
WRITTEN = (
    *("sin", "cos", "tan", "exp", "log", "sqrt", "reciprocal", "tanh", "sinh", "cosh"),
    *("atan", "asin", "acos", "rectify"),
)
"""Function blocks that `value_at` and `slope_at` implement."""


ROOMS = "evaluation", "backends/integration", "backends/lanes"
"""Folders with functions and records that are compiled into one another."""


def _folder() -> Path:
    """Return the Numba cache folder for the current sources.

    Numba checks only the module of a function, and would otherwise reuse code that has inlined an
    older version of another module.
    """
    package, sources = Path(__file__).parents[1], hashlib.sha256(repr(CODE).encode())
    for room in ROOMS:
        for module in sorted((package / room).rglob("*.py")):
            sources.update(module.read_bytes())
    outer = nb.config.CACHE_DIR or package / "__pycache__"  # pyright: ignore
    return Path(outer) / f"compiled-{sources.hexdigest()[:16]}"


_MATH: Any = {"contract", "nsz"}  # no flag that reorders sums


@contextmanager
def _kept_here() -> Iterator[None]:
    numba: Any = nb
    before, numba.config.CACHE_DIR = numba.config.CACHE_DIR, str(FOLDER)
    try:
        yield
    finally:
        numba.config.CACHE_DIR = before


def _njit(**options: bool) -> Any:
    compile_ = kept(fastmath=_MATH, no_cfunc_wrapper=True, **options)

    def decorated(function: Callable) -> Any:
        with _kept_here():
            return compile_(function)

    return decorated


def called_by_address(function: Callable, signature: Any) -> Any:
    """Compile a callback of generated code; see `kept_code.functions.callback`."""
    with _kept_here():
        return callback(function, signature, fastmath=_MATH)


FOLDER = _folder()
compiled = _njit()
"""Decorator: compiled once per machine and cached on disk."""
released = _njit(nogil=True)
"""Decorator like `compiled`, for functions that run in several threads."""
inner = _njit(no_cpython_wrapper=True)
"""Decorator like `compiled`, for functions called from compiled code only: without the Python
wrapper, which takes half of the compilation.
"""
inlined = _njit(no_cpython_wrapper=True, forceinline=True)
"""Decorator like `compiled`, for short functions: inlined, because a call passes every field of
every record.
"""


index = np.uint64
"""Conversion of an integer to an index that is known to be nonnegative."""


def check_written(codes: Iterable[int]) -> None:
    """Raise `NetworkError` if the compiled formulas lack a function block.

    The codes are those of `CODE`. The message names the function block.
    """
    for name in (FUNCTIONS[code].name for code in codes):
        if name not in WRITTEN:
            raise NetworkError(
                f"function block {name!r}: the interpreted evaluator and fixed-point programs have "
                f"no formula for it; add one to value_at and slope_at of {__name__}"
            )


@inner
def value_at(code, x):  # noqa: C901 - one line a function block
    """Return f(x) of the function block with a code."""
    if code == _SIN:
        return math.sin(x)
    if code == _COS:
        return math.cos(x)
    if code == _TAN:
        return math.tan(x)
    if code == _EXP:
        return np.exp(x)
    if code == _LOG:
        return np.log(x)
    if code == _SQRT:
        return np.sqrt(x)
    if code == _RECIPROCAL:
        return 1.0 / x
    if code == _TANH:
        return math.tanh(x)
    if code == _SINH:
        return np.sinh(x)
    if code == _COSH:
        return np.cosh(x)
    if code == _ATAN:
        return math.atan(x)
    if code == _ASIN:
        return np.arcsin(x)
    if code == _ACOS:
        return np.arccos(x)
    if code == _RECTIFY:
        return max(x, 0.0)
    return np.nan


@inner
def slope_at(code, x, y):  # noqa: C901 - one line a function block
    """Return df/dx of the function block with a code at x, with y = f(x)."""
    if code == _SIN:
        return math.cos(x)
    if code == _COS:
        return -math.sin(x)
    if code == _TAN:
        return 1.0 + y * y
    if code == _EXP:
        return y
    if code == _LOG:
        return 1.0 / x
    if code == _SQRT:
        return 0.5 / y
    if code == _RECIPROCAL:
        return -y * y
    if code == _TANH:
        return 1.0 - y * y
    if code == _SINH:
        return np.cosh(x)
    if code == _COSH:
        return np.sinh(x)
    if code == _ATAN:
        return 1.0 / (1.0 + x * x)
    if code == _ASIN:
        return 1.0 / np.sqrt(1.0 - x * x)
    if code == _ACOS:
        return -1.0 / np.sqrt(1.0 - x * x)
    if code == _RECTIFY:
        return 1.0 if x > 0.0 else 0.0
    return np.nan
