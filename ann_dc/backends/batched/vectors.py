"""Arithmetic of vectors in generated code: operators, and the functions of an array library.

A formula that takes its library as an argument, as `step_control.next_step` does, serves tensors
and generated code alike.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from ann_dc.evaluation.codegen.writer import Function


class Vector:
    """Vector in generated code, one number or truth value per lane.

    An operator adds an instruction; a comparison with a number that is not a number is false.
    """

    def __init__(self, f: Function, name: str) -> None:
        self.f, self.name = f, name

    def _with(self, instruction: str, other: Vector | float, *, reverse: bool = False) -> Vector:
        names = self.name, _name_of(self.f, other)
        return Vector(self.f, self.f.op(instruction, *(names[::-1] if reverse else names)))

    def __add__(self, other: Vector | float) -> Vector:
        return self._with("fadd", other)

    def __sub__(self, other: Vector | float) -> Vector:
        return self._with("fsub", other)

    def __rsub__(self, other: float) -> Vector:
        return self._with("fsub", other, reverse=True)

    def __mul__(self, other: Vector | float) -> Vector:
        return self._with("fmul", other)

    __rmul__ = __mul__

    def __truediv__(self, other: Vector | float) -> Vector:
        return self._with("fdiv", other)

    def __rtruediv__(self, other: float) -> Vector:
        return self._with("fdiv", other, reverse=True)

    def _compared(self, how: str, other: Vector | float) -> Vector:
        return Vector(self.f, self.f.compare(how, self.name, _name_of(self.f, other)))

    def __lt__(self, other: Vector | float) -> Vector:
        return self._compared("olt", other)

    def __gt__(self, other: Vector | float) -> Vector:
        return self._compared("ogt", other)

    def __ge__(self, other: Vector | float) -> Vector:
        return self._compared("oge", other)

    def equals(self, other: Vector | float) -> Vector:
        """Compare with an equal number."""
        return self._compared("oeq", other)

    def __and__(self, other: Vector) -> Vector:
        return Vector(self.f, self.f.logical("and", self.name, other.name))

    def __or__(self, other: Vector) -> Vector:
        return Vector(self.f, self.f.logical("or", self.name, other.name))

    def __invert__(self) -> Vector:
        return Vector(self.f, self.f.negated(self.name))


def _name_of(f: Function, value: Vector | float) -> str:
    """Return the name of a vector, or a constant with the same number in every lane."""
    return value.name if isinstance(value, Vector) else f.constant(value)


class VectorLibrary:
    """Functions of an array library on vectors of a function under construction."""

    def __init__(self, f: Function) -> None:
        self.f = f

    def load(self, address: str) -> Vector:
        """Load a vector."""
        return Vector(self.f, self.f.load(address))

    def mask(self, bits: str) -> Vector:
        """Convert an integer to the mask that its bits represent."""
        return Vector(self.f, self.f.mask(bits))

    def where(self, mask: Vector, a: Vector | float, b: Vector | float) -> Vector:
        """Select a in the lanes of a mask and b in the others."""
        f = self.f
        return Vector(f, f.select(mask.name, _name_of(f, a), _name_of(f, b)))

    def maximum(self, a: Vector, b: Vector | float) -> Vector:
        """Return the larger value; b if either is not a number."""
        return Vector(self.f, self.f.larger(a.name, _name_of(self.f, b)))

    def minimum(self, a: Vector, b: Vector | float) -> Vector:
        """Return the smaller value; b if either is not a number."""
        return Vector(self.f, self.f.smaller(a.name, _name_of(self.f, b)))

    def fma(self, a: Vector | float, b: Vector, c: Vector) -> Vector:
        """Compute a b + c with one rounding."""
        return Vector(self.f, self.f.fma(_name_of(self.f, a), b.name, c.name))

    def isfinite(self, a: Vector) -> Vector:
        """Return the mask of the finite numbers."""
        return self.abs(a) < math.inf

    def abs(self, a: Vector) -> Vector:
        """Return the magnitude."""
        return self._called("fabs", a)

    def sqrt(self, a: Vector) -> Vector:
        """Return the square root."""
        return self._called("sqrt", a)

    def exp(self, a: Vector) -> Vector:
        """Return the exponential."""
        return self._called("exp", a)

    def log(self, a: Vector) -> Vector:
        """Return the natural logarithm."""
        return self._called("log", a)

    def power(self, a: Vector, exponent: float) -> Vector:
        """Return a power."""
        return Vector(self.f, self.f.call("pow", a.name, self.f.constant(exponent)))

    def _called(self, name: str, a: Vector) -> Vector:
        return Vector(self.f, self.f.call(name, a.name))

    def rarely(self, mask: Vector, make: Callable[[], Vector], otherwise: Vector) -> Vector:
        """Select made numbers in the lanes of a mask; they are made if any lane needs them."""
        f = self.f

        def made() -> list[str]:
            return [self.where(mask, make(), otherwise).name]

        (found,) = f.either(f.any_of(mask.name), made, [otherwise.name])
        return Vector(f, found)
