"""Writer of functions in LLVM's language: vectors, loops, loads and stores.

Every value has one name and never changes. A formula is therefore written as a Python expression,
from the inside out, one instruction per call. Numbers that change in a loop are stored in a `slot`,
which LLVM converts to a register.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from functools import reduce


def number(value: float) -> str:
    """Return the LLVM notation of a double, its bits."""
    return f"0x{struct.unpack('<Q', struct.pack('<d', value))[0]:016X}"


class Module:
    """Functions of one piece of code and their external declarations."""

    def __init__(self) -> None:
        self._bodies: list[str] = []
        self._declared: dict[str, str] = {}

    def declare(self, name: str, result: str, arguments: Sequence[str]) -> str:
        """Declare an external function and return its name."""
        self._declared[name] = f"declare {result} @{name}({', '.join(arguments)})"
        return f"@{name}"

    def add(self, function: Function) -> None:
        """Add a complete function."""
        self._bodies.append(function.text())

    def text(self) -> str:
        """Return the text of the module."""
        return "\n".join([*self._declared.values(), *self._bodies])


class Function:
    """Function under construction; methods add a line and return a value's name.

    All arguments are addresses, except the integers ``numbers``. ``width`` is the number of lanes
    of a vector.
    """

    def __init__(
        self,
        module: Module,
        name: str,
        arguments: tuple[str, ...],
        *,
        width: int,
        numbers: tuple[str, ...] = (),
    ) -> None:
        self.module, self.width, self.vector = module, width, f"<{width} x double>"
        typed = [f"i64 %{a}" if a in numbers else f"ptr %{a}" for a in arguments]
        self._head = f"define i64 @{name}({', '.join(typed)}) nounwind {{"
        self._entry: list[str] = []
        self._lines: list[str] = []
        self._count = 0
        self._block = "start"

    def text(self) -> str:
        """Return the text of the function."""
        entry = [self._head, "entry:", *self._entry, "br label %start", "start:"]
        return "\n".join([*entry, *self._lines, "}"])

    # ---- instructions ------------------------------------------------------------------------

    def _name(self) -> str:
        self._count += 1
        return f"%v{self._count}"

    def value(self, instruction: str) -> str:
        """Add an instruction and return the name of its value."""
        name = self._name()
        self._lines.append(f"{name} = {instruction}")
        return name

    def do(self, instruction: str) -> None:
        """Add an instruction without a value."""
        self._lines.append(instruction)

    def of_type(self, width: int | None) -> str:
        """Return the type of a vector with a number of lanes, by default all.

        The type for one lane is a scalar.
        """
        return self.vector if width is None else "double" if width == 1 else f"<{width} x double>"

    def constant(self, value: float, width: int | None = None) -> str:
        """Return a constant with the same number in every lane."""
        if width == 1:
            return number(value)
        return "<" + ", ".join([f"double {number(value)}"] * (width or self.width)) + ">"

    def op(self, name: str, *values: str, width: int | None = None) -> str:
        """Add vector arithmetic: ``fadd``, ``fsub``, ``fmul``, ``fdiv``, ``fneg``."""
        return self.value(f"{name} {self.of_type(width)} {', '.join(values)}")

    def call(self, name: str, *values: str, width: int | None = None) -> str:
        """Call an LLVM intrinsic on vectors: ``fma``, ``fabs``, ``sqrt``, ``maxnum``."""
        of = self.of_type(width)
        suffix = "f64" if width == 1 else f"v{width or self.width}f64"
        called = self.module.declare(f"llvm.{name}.{suffix}", of, [of] * len(values))
        return self.value(f"call {of} {called}({', '.join(f'{of} {v}' for v in values)})")

    def fma(self, a: str, b: str, c: str, width: int | None = None) -> str:
        """Compute a b + c."""
        return self.call("fma", a, b, c, width=width)

    def compare(self, how: str, a: str, b: str, width: int | None = None) -> str:
        """Compare lane by lane with an LLVM predicate: ``olt``, ``oge``, ``une``, ``uno``."""
        return self.value(f"fcmp {how} {self.of_type(width)} {a}, {b}")

    def logical(self, name: str, a: str, b: str, width: int | None = None) -> str:
        """Combine comparisons with ``and``, ``or``, ``xor``."""
        return self.value(f"{name} <{width or self.width} x i1> {a}, {b}")

    def select(self, mask: str, a: str, b: str, width: int | None = None) -> str:
        """Select a in the lanes of a mask and b in the others."""
        of = self.of_type(width)
        masks = "i1" if width == 1 else f"<{width or self.width} x i1>"
        return self.value(f"select {masks} {mask}, {of} {a}, {of} {b}")

    def any_mask(self, *masks: str) -> str:
        """Combine comparisons to a mask of the lanes in which any one is true."""
        return reduce(lambda a, b: self.logical("or", a, b), masks)

    def negated(self, mask: str) -> str:
        """Return the mask of the lanes in which a comparison is false."""
        every = "<" + ", ".join(["i1 true"] * self.width) + ">"
        return self.logical("xor", mask, every)

    def larger(self, a: str, b: str, width: int | None = None) -> str:
        """Return the larger value; b if either is not a number."""
        return self.select(self.compare("ogt", a, b, width), a, b, width)

    def smaller(self, a: str, b: str, width: int | None = None) -> str:
        """Return the smaller value; b if either is not a number."""
        return self.select(self.compare("olt", a, b, width), a, b, width)

    def bits(self, mask: str) -> str:
        """Convert a mask to an integer, one bit per lane."""
        lanes = f"i{self.width}"
        packed = self.value(f"bitcast <{self.width} x i1> {mask} to {lanes}")
        return self.value(f"zext {lanes} {packed} to i64")

    def mask(self, bits: str) -> str:
        """Convert an integer to the mask that its bits represent."""
        lanes = f"i{self.width}"
        packed = self.value(f"trunc i64 {bits} to {lanes}")
        return self.value(f"bitcast {lanes} {packed} to <{self.width} x i1>")

    def any_of(self, mask: str) -> str:
        """Return True in the generated code if a comparison is true in any lane."""
        of = f"<{self.width} x i1>"
        called = self.module.declare(f"llvm.vector.reduce.or.v{self.width}i1", "i1", [of])
        return self.value(f"call i1 {called}({of} {mask})")

    def across(self, name: str, vector: str) -> str:
        """Reduce the lanes to a number with ``fmax``, or ``fadd`` in lane order."""
        of, first = self.vector, "double 0.0, " if name == "fadd" else ""
        types = ["double", of] if first else [of]
        called = self.module.declare(f"llvm.vector.reduce.{name}.v{self.width}f64", "double", types)
        return self.value(f"call double {called}({first}{of} {vector})")

    # ---- lanes -------------------------------------------------------------------------------

    def shuffle(self, a: str, b: str, lanes: Iterable[int], width: int | None = None) -> str:
        """Return chosen lanes of two concatenated vectors."""
        of, mask = self.of_type(width), list(lanes)
        chosen = ", ".join(f"i32 {lane}" for lane in mask)
        return self.value(f"shufflevector {of} {a}, {of} {b}, <{len(mask)} x i32> <{chosen}>")

    def spread(self, scalar: str, width: int | None = None) -> str:
        """Return a vector with a number in every lane."""
        of, count = self.of_type(width), width or self.width
        one = self.value(f"insertelement {of} poison, double {scalar}, i32 0")
        return self.shuffle(one, "poison", [0] * count, width)

    def lane(self, vector: str, lane: int, width: int | None = None) -> str:
        """Return the number in a lane."""
        return self.value(f"extractelement {self.of_type(width)} {vector}, i32 {lane}")

    def with_lane(self, vector: str, scalar: str, lane: int, width: int | None = None) -> str:
        """Return a copy of a vector with another number in a lane."""
        of = self.of_type(width)
        return self.value(f"insertelement {of} {vector}, double {scalar}, i32 {lane}")

    # ---- integers and memory -----------------------------------------------------------------

    def integer(self, name: str, a: str, b: str | int) -> str:
        """Add integer arithmetic: ``add``, ``sub``, ``mul``, ``sdiv``, ``ashr``, ``and``."""
        return self.value(f"{name} i64 {a}, {b}")

    def address(self, base: str, *offsets: str | int) -> str:
        """Return the address of a double at offsets, in doubles, from a base address."""
        for offset in offsets:
            if offset != 0:
                base = self.value(f"getelementptr double, ptr {base}, i64 {offset}")
        return base

    def load(self, address: str, width: int | None = None) -> str:
        """Load a vector, or one number for a width of 1."""
        return self.value(f"load {self.of_type(width)}, ptr {address}, align 8")

    def store(self, vector: str, address: str, width: int | None = None) -> None:
        """Store a vector, or one number for a width of 1."""
        self.do(f"store {self.of_type(width)} {vector}, ptr {address}, align 8")

    def load_integer(self, address: str) -> str:
        """Load an integer."""
        return self.value(f"load i64, ptr {address}, align 8")

    def field(self, base: str, index: int, kind: str = "ptr") -> str:
        """Load an entry of a table of addresses and integers."""
        return self.value(f"load {kind}, ptr {self.address(base, index)}, align 8")

    def slot(self, start: str | None = None, width: int | None = None) -> str:
        """Allocate a place for a changing vector, initially zero by default."""
        name, of = self._name(), self.of_type(width)
        self._entry.append(f"{name} = alloca {of}, align 64")
        self.store(start or self.constant(0.0, width), name, width)
        return name

    # ---- control -----------------------------------------------------------------------------

    @contextmanager
    def loop(self, count: str | int, first: str | int = 0) -> Iterator[str]:
        """Open a loop for i in range(first, count), as a context manager.

        The condition is tested before the first pass.
        """
        label, i, following = self._name()[1:], self._name(), self._name()
        before = self._block
        head, body, behind = f"head_{label}", f"body_{label}", f"behind_{label}"
        self.do(f"br label %{head}")
        self.do(f"{head}:")
        placeholder = len(self._lines)
        self.do("")
        self.do(f"{i}_more = icmp slt i64 {i}, {count}")
        self.do(f"br i1 {i}_more, label %{body}, label %{behind}")
        self._open(body)
        yield i
        self.do(f"{following} = add i64 {i}, 1")
        self._lines[placeholder] = (
            f"{i} = phi i64 [ {first}, %{before} ], [ {following}, %{self._block} ]"
        )
        self.do(f"br label %{head}")
        self._open(behind)

    def either(
        self, condition: str, rarely: Callable[[], Sequence[str]], else_: Sequence[str]
    ) -> list[str]:
        """Branch to ``rarely`` if a condition is true, else use the vectors ``else_``.

        The branch to ``rarely`` is marked as improbable.
        """
        label, before = self._name()[1:], self._block
        expected = self.module.declare("llvm.expect.i1", "i1", ["i1", "i1"])
        rare = self.value(f"call i1 {expected}(i1 {condition}, i1 false)")
        self.do(f"br i1 {rare}, label %then_{label}, label %behind_{label}")
        self._open(f"then_{label}")
        found = rarely()
        then = self._block
        self.do(f"br label %behind_{label}")
        self._open(f"behind_{label}")
        pairs = zip(found, else_)
        return [
            self.value(f"phi {self.vector} [ {a}, %{then} ], [ {b}, %{before} ]") for a, b in pairs
        ]

    def _open(self, block: str) -> None:
        self._block = block
        self.do(f"{block}:")

    def done(self, result: str = "0") -> None:
        """Add the return of the integer result and add the function to its module."""
        self.do(f"ret i64 {result}")
        self.module.add(self)
