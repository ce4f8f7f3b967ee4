"""Scaling of a preconditioner to time constants that differ from its design.

A stiffness preconditioner is M = T^{1/2} S^{-1} T^{1/2}. For a sample with T' = R T R and the same
S, the preconditioner is R M R: net inputs and derivatives are both scaled by the roots R.
"""

from __future__ import annotations

from collections.abc import Sequence

from ann_dc.evaluation.codegen.writer import Function


def add_scaling(
    f: Function, base: dict[str, str], rows: Sequence[int], neurons: int, source: str, target: str
) -> None:
    """Write ``target = roots source`` for some neurons of every cell (lane: sample).

    ``base`` contains the addresses of ``roots``, ``source`` and ``target`` (tables without ghosts)
    and of ``chunks``. ``rows`` are the scaled neurons of the P ``neurons`` of a cell.
    """
    with f.loop(base["chunks"]) as chunk:
        first = f.integer("mul", chunk, neurons * f.width)
        for row in rows:
            at = {n: f.address(base[n], first, row * f.width) for n in ("roots", source, target)}
            f.store(f.op("fmul", f.load(at["roots"]), f.load(at[source])), at[target])
