"""Numba functions loaded from the compile cache without loading the compiler.

Before Numba reads a function from its cache, it loads all its support for Python and NumPy for a
possible compilation: 0.15 s. Its compiler loads this support by itself when it is needed.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, cast

import numba as nb
from numba.core.caching import FunctionCache
from numba.core.ccallback import CFunc
from numba.core.runtime.nrt import rtsys


class _Cache(FunctionCache):
    def load_overload(self, sig: Any, target_context: Any) -> Any:
        rtsys.initialize(target_context)  # the allocator, which is all that such code needs
        with self._guard_against_spurious_io_errors():
            return self._load_overload(sig, target_context)


def kept(**options: Any) -> Callable[[Callable], Any]:
    """Return a decorator that compiles a function on first call, once per machine.

    `options` are those of `numba.njit`.
    """
    compile_: Any = nb.njit(error_model="numpy", **options)

    def decorated(function: Callable) -> Any:
        dispatcher = compile_(function)
        dispatcher._cache = _Cache(function)
        return dispatcher

    return decorated


def callback(function: Callable, signature: Any, **options: Any) -> Any:
    """Compile a function that other code calls by its address, once per machine.

    `signature` is a Numba signature of numbers and pointers, and `options` are those of
    `numba.njit`. The result must live as long as its ``address`` is called.
    """
    arguments = signature.args, signature.return_type
    made = CFunc(function, arguments, {}, {"error_model": "numpy", "nopython": True, **options})
    cast(Any, made)._cache = _Cache(function)
    made.compile()
    return made
