"""Compiled formulas of all function blocks, and compiler settings of the package.

The text of the formulas is written from the trees of `ann_dc.network.functions`.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numba as nb
import numpy as np

from ann_dc.errors import NetworkError
from ann_dc.jit_functions import callback, kept
from ann_dc.network.functions import FUNCTIONS, NUMPY, OPERATIONS, Tree, written

_FORMS = NUMPY | {"maximum": "max({}, {})", "where": "({1} if {0} else {2})"}
"""Operations of trees in Python, as Numba compiles it."""


def _trees() -> dict[int, tuple[Tree, Tree]]:
    """Return value and slope by code, without the function blocks that cannot be traced."""
    found: dict[int, tuple[Tree, Tree]] = {}
    for code, block in enumerate(FUNCTIONS):
        with suppress(NetworkError):  # raised by name where a network has the block
            found[code] = block.trees
    return found


def _source() -> str:
    """Return the text of two functions with one branch per function block."""
    lines: list[str] = []
    for head, place in (("value_at(code, x)", 0), ("slope_at(code, x, y)", 1)):
        lines.append(f"def {head}:")
        for code, trees in _trees().items():
            formula = written(trees[place], {"x": "x", "y": "y"}, _FORMS)
            lines += [f"    if code == {code}:", f"        return {formula}"]
        lines.append("    return np.nan")
    return "\n".join(lines)


WRITTEN = frozenset(FUNCTIONS[code].name for code in _trees())
"""Function blocks that `value_at` and `slope_at` implement."""

ROOMS = "evaluation", "backends/integration", "backends/batched"
"""Folders with functions and records that are compiled into one another."""


def _folder() -> Path:
    """Return the Numba cache folder for the current sources.

    Numba checks only the module of a function, and would otherwise reuse code that has inlined an
    older version of another module.
    """
    package, sources = Path(__file__).parents[1], hashlib.sha256(_source().encode())
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


def _njit(**options: Any) -> Any:
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
lengthy = _njit(seconds=3.0)
"""Decorator like `compiled`, for functions whose compilation is announced."""
released = _njit(nogil=True, seconds=6.0)
"""Decorator like `lengthy`, for functions that run in several threads."""
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

    The codes are those of `ann_dc.network.functions.CODE`. The message names the function block.
    """
    for block in (FUNCTIONS[code] for code in codes):
        if block.name not in WRITTEN:
            raise NetworkError(
                f"function block {block.name!r}: the interpreted evaluator and fixed-point "
                f"programs have no formula for it; use {', '.join(OPERATIONS)}"
            )


def _compiled_formulas() -> tuple[Any, Any]:
    """Compile `value_at` and `slope_at`; the cache files them under this module."""
    names: dict[str, Any] = {"np": np, "__name__": __name__}
    exec(compile(_source(), __file__, "exec"), names)
    return inner(names["value_at"]), inner(names["slope_at"])


value_at, slope_at = _compiled_formulas()
"""Compiled f(x) by code and x, and df/dx by code, x and y = f(x)."""
