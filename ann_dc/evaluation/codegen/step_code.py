"""Vector code of explicit integration methods: sums of slopes and error norms.

A step length is one number for all lanes or one number per lane. Array lengths are data.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path

from ann_dc.evaluation.codegen.code import code, key_of
from ann_dc.evaluation.codegen.writer import Function, Module

UNROLLED = 16
"""Numbers of a state that are processed at a time; arrays contain whole blocks."""
NAMES = "combine", "error"


@cache
def step_code(lanes: int, *, is_shared: bool) -> dict[str, int]:
    """Return the addresses of the functions that integrators call.

    ``combine(out, x, slopes, weights, which, h; count, n)`` computes ``out = x + h sum_j weights[j]
    slopes[which[j]]``; weights are shared if h is shared.

    ``error(x, ahead, slopes, weights, which, scales, out; first, both, n)`` sums the squares of two
    estimates over rtol max(|x|, |ahead|) + atol. ``scales`` contains rtol, then atol. The first
    estimate uses the first weights (``first``), the second estimate the rest, up to ``both``.

    ``lanes`` is the number of lanes of a vector. ``is_shared`` is True if all lanes have one step;
    errors are then summed over all lanes.
    """
    key = key_of(("steps", lanes, is_shared), Path(__file__).parent)
    return code(key, lambda: _text(lanes, is_shared), NAMES)


def _text(lanes: int, is_shared: bool) -> str:
    module = Module()
    _combine(module, lanes, is_shared)
    _error(module, lanes, is_shared)
    return module.text()


def _per_lane(f: Function, address: str, is_shared: bool) -> str:
    return f.spread(f.load(address, 1)) if is_shared else f.load(address)


def _sum(
    f: Function,
    terms: tuple[str, str, str],
    span: tuple[str | int, str],
    at: list[str],
    is_shared: bool,
) -> list[str]:
    """Sum weighted slopes at some places of the state, over a span of the weights."""
    slopes, weights, which = terms
    (first, last), sums = span, [f.slot() for _ in at]
    for total in sums:
        f.store(f.constant(0.0), total)
    with f.loop(last, first) as j:
        entry = j if is_shared else f.integer("mul", j, f.width)
        weight = _per_lane(f, f.address(weights, entry), is_shared)
        row = f.address(slopes, f.load_integer(f.address(which, j)))
        for place, total in zip(at, sums):
            f.store(f.fma(weight, f.load(f.address(row, place)), f.load(total)), total)
    return [f.load(total) for total in sums]


def _places(f: Function, block: str) -> list[str]:
    first = f.integer("mul", block, UNROLLED)
    return [f.integer("add", first, i * f.width) for i in range(UNROLLED // f.width)]


def _combine(module: Module, lanes: int, is_shared: bool) -> None:
    names = "out", "x", "slopes", "weights", "which", "h", "count", "n"
    f = Function(module, "combine", names, width=lanes, numbers=names[-2:])
    h = _per_lane(f, "%h", is_shared)
    with f.loop(f.integer("sdiv", "%n", UNROLLED)) as block:
        at = _places(f, block)
        sums = _sum(f, ("%slopes", "%weights", "%which"), (0, "%count"), at, is_shared)
        for place, total in zip(at, sums):
            ahead = f.fma(h, total, f.load(f.address("%x", place)))
            f.store(ahead, f.address("%out", place))
    f.done()


def _error(module: Module, lanes: int, is_shared: bool) -> None:
    names = "x", "ahead", "slopes", "weights", "which", "scales", "out", "first", "both", "n"
    f = Function(module, "error", names, width=lanes, numbers=names[-3:])
    rtol = _per_lane(f, "%scales", is_shared)
    atol = _per_lane(f, f.address("%scales", 1 if is_shared else lanes), is_shared)
    sizes = [f.slot(), f.slot()]
    with f.loop(f.integer("sdiv", "%n", UNROLLED)) as block:
        at = _places(f, block)
        terms = "%slopes", "%weights", "%which"
        spans = (0, "%first"), ("%first", "%both")
        estimates = [_sum(f, terms, span, at, is_shared) for span in spans]
        for i, place in enumerate(at):
            x, ahead = (f.load(f.address(base, place)) for base in ("%x", "%ahead"))
            largest = f.call("maxnum", f.call("fabs", x), f.call("fabs", ahead))
            scale = f.op("fdiv", f.constant(1.0), f.fma(rtol, largest, atol))
            for size, estimate in zip(sizes, estimates):
                relative = f.op("fmul", estimate[i], scale)
                f.store(f.fma(relative, relative, f.load(size)), size)
    for number, size in enumerate(sizes):
        _give(f, f.load(size), number, is_shared)
    f.done()


def _give(f: Function, total: str, number: int, is_shared: bool) -> None:
    """Store a sum, of all lanes or one per lane."""
    if is_shared:
        f.store(f.across("fadd", total), f.address("%out", number), 1)
    else:
        f.store(total, f.address("%out", number * f.width))
