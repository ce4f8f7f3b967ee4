"""Functions that Numba compiles are loaded from disk without what compiles.

Before Numba reads a function from its cache it loads all that it knows of Python and NumPy, for
what may have to be compiled: 0.15 s. Its compiler does so by itself when something is.
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


def callback(function: Callable, signature: Any, **options: Any) -> Any:
    """Compile a function that other code calls by its address, once per machine.

    Parameters
    ----------
    function : callable
    signature : Signature
        Numba's, of numbers and pointers.
    **options
        Of `numba.njit`.

    Returns
    -------
    CFunc
        It has to live as long as its ``address`` is called.
    """
    arguments = signature.args, signature.return_type
    made = CFunc(function, arguments, {}, {"error_model": "numpy", "nopython": True, **options})
    cast(Any, made)._cache = _Cache(function)
    made.compile()
    return made
