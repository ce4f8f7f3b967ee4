"""Calls from compiled loops to code at an address, ``i64 f(ptr, ..., i64, ...)``.

Arrays are passed as a table of integers, `WIDTH` for each array: its address and three sizes.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic, register_jitable
from numba.np.numpy_support import carray

WIDTH = 4
"""Integers per array in a table."""


def entries(arrays: Iterable[np.ndarray]) -> list[int]:
    """Return the table entries of contiguous arrays.

    The arrays contain 64-bit numbers and have at most three axes. They must exist as long as the
    table.
    """
    found = []
    for array in arrays:
        assert array.flags.c_contiguous
        assert array.dtype in (np.float64, np.int64), array.dtype
        found += [array.ctypes.data, *(*array.shape, 1, 1, 1)[:3]]
    return found


def _call(typingctx, address, pointers, numbers):
    """Call the function at an address with addresses and integers, in this order.

    The result of a function that returns nothing is meaningless.
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
"""`_call` for compiled loops."""


def _pointer(kind: Any) -> Any:
    def typed(typingctx, address):
        def generate(context, builder, signature, values):
            width = ir.DoubleType() if kind is types.float64 else ir.IntType(64)
            return builder.inttoptr(values[0], width.as_pointer())

        return types.CPointer(kind)(types.int64), generate

    return intrinsic(typed)


floats, integers = _pointer(types.float64), _pointer(types.int64)
"""Pointer to numbers at an address, for compiled loops."""


def _view(pointed: Any, axes: int) -> Any:
    """Compile a view of the array described at a position of a table."""

    @register_jitable
    def view(table, at):
        sizes = table[at + 1], table[at + 2], table[at + 3]
        return carray(pointed(table[at]), sizes[:axes])

    return view


vector, matrix, cube = (_view(floats, axes) for axes in (1, 2, 3))
integer_vector, integer_matrix = (_view(integers, axes) for axes in (1, 2))
