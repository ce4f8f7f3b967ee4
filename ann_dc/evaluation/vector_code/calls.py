"""Calls from compiled loops to code at an address: ``i64 f(ptr, ..., i64, ...)``."""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic


def _call(typingctx, address, pointers, numbers):
    """Call the function at an address.

    Parameters
    ----------
    address : int
    pointers, numbers : tuples of int
        Addresses and integers that it takes, in this order.

    Returns
    -------
    int
        What it gives; nothing useful for one that gives nothing.
    """

    def generate(context, builder, signature, values):
        pointer, integer = ir.IntType(8).as_pointer(), ir.IntType(64)
        given = [
            builder.inttoptr(builder.extract_value(values[1], i), pointer)
            for i in range(len(pointers))
        ]
        given += [builder.extract_value(values[2], i) for i in range(len(numbers))]
        kinds = [pointer] * len(pointers) + [integer] * len(numbers)
        function = builder.inttoptr(values[0], ir.FunctionType(integer, kinds).as_pointer())
        return builder.call(function, given)

    return types.int64(address, pointers, numbers), generate


call: Any = intrinsic(_call)
"""`_call`, as compiled loops have it."""
