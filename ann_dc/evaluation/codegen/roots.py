"""Time constants that a metric was not made for: what it reads and gives, scaled by their roots.

A stiffness is M = T^{1/2} S^{-1} T^{1/2}. Where a sample has T' = R T R, its moves are those of the
same metric between scaled drives and scaled moves, R M R; S stays.
"""

from __future__ import annotations

from collections.abc import Sequence

from ann_dc.evaluation.codegen.writer import Function


def add_scaling(
    f: Function, base: dict[str, str], rows: Sequence[int], neurons: int, source: str, target: str
) -> None:
    """``target = roots source`` for some neurons of every cell; a lane is a sample.

    Parameters
    ----------
    f : Function
        Whose lines come next.
    base : dict of str to str
        Addresses of ``roots``, ``source`` and ``target``, tables without ghosts; and ``chunks``.
    rows : sequence of int
        Of the neurons.
    neurons : int
        P.
    source, target : str
        Names of tables.
    """
    with f.loop(base["chunks"]) as chunk:
        first = f.integer("mul", chunk, neurons * f.width)
        for row in rows:
            at = {n: f.address(base[n], first, row * f.width) for n in ("roots", source, target)}
            f.store(f.op("fmul", f.load(at["roots"]), f.load(at[source])), at[target])
