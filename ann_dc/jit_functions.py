"""Numba functions loaded from the compile cache without loading the compiler.

Before Numba reads a function from its cache, it loads all its support for Python and NumPy for a
possible compilation: 0.15 s. Its compiler loads this support by itself when it is needed.

The first long compilation of a process is announced in one line of the logger ``ann_dc``, which
Python prints on stderr; ``logging.getLogger("ann_dc").setLevel("ERROR")`` silences the line.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import Any, cast

import numba as nb
from numba.core.caching import FunctionCache
from numba.core.ccallback import CFunc
from numba.core.runtime.nrt import rtsys

ANNOUNCED = 2.0
"""Usual duration in seconds from which a compilation is announced."""


class _Cache(FunctionCache):
    seconds = 0.0
    """Usual duration of the compilation."""
    announced = False
    """True if this process has announced a compilation."""

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        rtsys.initialize(target_context)  # the allocator, which is all that such code needs
        with self._guard_against_spurious_io_errors():
            found = self._load_overload(sig, target_context)
        if found is None and self.seconds > ANNOUNCED and not _Cache.announced:
            _Cache.announced = True
            line = "ann_dc: compiling the solver (about 10 s, cached in %s for later runs)"
            logging.getLogger("ann_dc").warning(line, self.cache_path)
        return found


def kept(*, seconds: float = 0.0, **options: Any) -> Callable[[Callable], Any]:
    """Return a decorator that compiles a function on first call, once per machine.

    `seconds` is the usual duration of the compilation, and `options` are those of `numba.njit`.
    """
    compile_: Any = nb.njit(error_model="numpy", **options)

    def decorated(function: Callable) -> Any:
        dispatcher = compile_(function)
        dispatcher._cache = _Cache(function)
        dispatcher._cache.seconds = seconds
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
