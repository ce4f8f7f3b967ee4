"""Functions that Numba compiles are loaded from disk without what compiles.

Before Numba reads a function from its cache it loads all that it knows of Python and NumPy, for
what may have to be compiled: 0.15 s. Its compiler does so by itself when something is.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numba as nb
from numba.core.caching import FunctionCache
from numba.core.runtime.nrt import rtsys


class _Cache(FunctionCache):
    def load_overload(self, sig: Any, target_context: Any) -> Any:
        rtsys.initialize(target_context)  # the allocator, which is all that such code needs
        with self._guard_against_spurious_io_errors():
            return self._load_overload(sig, target_context)


def kept(**options: Any) -> Callable[[Callable], Any]:
    """Compile a function when it is first called, once per machine.

    Parameters
    ----------
    **options
        Of `numba.njit`.

    Returns
    -------
    callable
        Decorates a function.
    """
    compile_: Any = nb.njit(error_model="numpy", **options)

    def decorated(function: Callable) -> Any:
        dispatcher = compile_(function)
        dispatcher._cache = _Cache(function)
        return dispatcher

    return decorated
