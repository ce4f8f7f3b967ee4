"""Residuals of a state as vector code, after the net inputs are computed."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import reduce

from ann_dc.evaluation.codegen.writer import Function, Module
from ann_dc.evaluation.rules import DUAL, FLOOR, POSITION, SMALLEST_POSITION, STATE


def add_residuals(
    module: Module, roles: Sequence[int], fields: Callable[[Function], dict[str, str]], *,
    width: int, ghosts: int, is_row: bool,
) -> None:  # fmt: skip
    """Add ``i64 residuals(table, x, out)``: `rules.residuals` and max|x|.

    The results are one per lane if a lane is a sample, and one in total if a lane is a stage
    (``is_row``). The roles (P integers) are those of a tape. ``fields`` returns the addresses of
    tables by name as a function reads them; ``chunks`` and ``drives`` are needed. ``width`` is the
    number of lanes, ``ghosts`` that of the ghost chunks at an end of the states.
    """
    f = Function(module, "residuals", ("table", "x", "out"), width=width)
    base, lanes = fields(f), width
    names = ("constraint", "gradient", "still", "position", "dual", "state", "other")
    largest, lost = {name: f.slot() for name in names}, [f.slot() for _ in range(4)]
    size = len(roles) * lanes

    def grow(name: str, value: str) -> None:
        f.store(f.larger(value, f.load(largest[name])), largest[name])

    with f.loop(base["chunks"]) as chunk:
        drive_at = f.address(base["drives"], f.integer("mul", chunk, size))
        x_at = f.address("%x", f.integer("mul", f.integer("add", chunk, ghosts), size))
        for row, role in enumerate(roles):
            drive = f.load(f.address(drive_at, row * lanes))
            slot = lost[row % len(lost)]  # what is no number becomes none: one wait for each slot
            f.store(f.fma(drive, f.constant(0.0), f.load(slot)), slot)
            grow({DUAL: "constraint", STATE: "still"}.get(role, "gradient"), f.call("fabs", drive))
            kind = {DUAL: "dual", STATE: "state", POSITION: "position"}.get(role, "other")
            grow(kind, f.call("fabs", f.load(f.address(x_at, row * lanes))))
    found, one = {name: f.load(slot) for name, slot in largest.items()}, None
    found["lost"] = reduce(lambda a, b: f.op("fadd", a, b), [f.load(slot) for slot in lost])
    if is_row:
        one = 1
        found = {n: f.across("fadd" if n == "lost" else "fmax", v) for n, v in found.items()}

    def relative(residual: str, size: str, least: float) -> str:
        least_size = f.call("maxnum", found[size], f.constant(least, one), width=one)
        return f.op("fdiv", found[residual], least_size, width=one)

    constraint = relative("constraint", "position", SMALLEST_POSITION)
    still = relative("still", "state", 1.0)
    rest = f.call("maxnum", relative("gradient", "dual", FLOOR), still, width=one)
    for place, value in enumerate((constraint, rest)):
        value = f.op("fadd", value, found["lost"], width=one)
        is_none = f.compare("uno", value, value, width=one)
        value = f.select(is_none, f.constant(math.inf, one), value, width=one)
        f.store(value, f.address("%out", place * (one or lanes)), one)
    states = [found[name] for name in ("position", "dual", "state", "other")]
    everywhere = reduce(lambda a, b: f.larger(a, b, one), states)
    f.store(everywhere, f.address("%out", 2 * (one or lanes)), one)
    f.done()
