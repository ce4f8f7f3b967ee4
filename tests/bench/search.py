"""Random problems: certified solutions, optima and computing time.

Ten problems of each of eight families (`random_problems`), and the same with limits on controls and
on a state that the unconstrained optimum of IPOPT would cross. Six starts of IPOPT tell the best
optimum that is known; problems to which none of them leads are left out. A certified optimum counts
as false if IPOPT, started there, leaves it for a cheaper one close by.
"""

import argparse
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from bench.figure import Figure, show
from random_problems import FAMILIES, problem
from reference import ipopt

import ann_dc
from ann_dc.gain_design.rule_presets import COARSE
from ann_dc.optimality.reference_solvers import ipopt_point

SEEDS = range(10)
STARTS = 6
LIMIT = 60.0
"""Seconds that a call of `solve` may take."""
SAME = 1e-4
"""Relative difference of objectives up to which optima are the same."""
EASY = "", *COARSE
"""Starts of networks that need no path."""


@dataclass(frozen=True)
class ArrayLayout:
    """One problem."""

    name: str
    certified: bool
    best: bool
    settled: bool
    coarse: bool
    false: bool
    late: float
    seconds: float
    remark: str


def constrained(given):
    """The same with limits that its optimum crosses; None where IPOPT finds none."""
    free = ipopt(given)
    if not free.success:
        return None
    rng = np.random.default_rng(len(given.name) + given.horizon)
    bounds = {}
    for symbol, values in zip(given.controls, free.u):
        peak = np.abs(values).max()
        if peak > 1e-3:
            bounds[str(symbol)] = (-rng.uniform(0.7, 1.2) * peak, rng.uniform(0.7, 1.2) * peak)
    ends = [v[0] for v in (given.q_0, given.q_d) if v is not None and v[0] is not None]
    high = max([*ends, float(free.q[0].max()) - 0.15 * float(np.ptp(free.q[0]))])
    bounds[str(given.states[0])] = (None, high + 1e-3 * abs(high) + 1e-6)
    return replace(given, bounds=bounds, name=f"{given.name} limited")


def known(given) -> float:
    """Objective of the best optimum that starts of IPOPT lead to; nan if none leads to any."""
    found = [ipopt(given), *(ipopt(given, seed=seed) for seed in range(STARTS - 1))]
    return min((one.objective for one in found if one.success), default=float("nan"))


def is_false(given, solution) -> bool:
    """Whether IPOPT leaves a certified optimum for a cheaper one close by."""
    q, u = (np.stack([solution[str(s)] for s in of]) for of in (given.states, given.controls))
    there = ipopt_point(given, q, u)
    if there is None:
        return False
    size = max(np.abs(there.u).max(), 1e-9)
    cheaper = there.objective < solution.objective - SAME * max(abs(solution.objective), 1e-3)
    return bool(cheaper and np.abs(there.u - u).max() < 0.1 * size)


def measure(given) -> ArrayLayout | None:
    """Solve a problem; None where IPOPT knows no optimum."""
    best = known(given)
    if not np.isfinite(best):
        return None
    began, wall = time.process_time(), time.perf_counter()
    try:
        solution = ann_dc.solve(given, time_limit=LIMIT)
    except ann_dc.errors.AnnDcError as error:
        return ArrayLayout(given.name, False, False, False, False, False, 0.0, 0.0, str(error)[:90])
    seconds, wall = time.process_time() - began, time.perf_counter() - wall
    near = solution.objective <= best + SAME * max(abs(best), 1e-3)
    settled = solution.certified and solution.status.settled
    start = solution.design.start if solution.design is not None else ""
    return ArrayLayout(
        name=given.name,
        certified=solution.certified,
        best=solution.certified and near,
        settled=settled,
        coarse=settled and start in EASY,
        false=solution.certified and is_false(given, solution),
        late=wall - LIMIT,
        seconds=seconds,
        remark=f"{start or 'its own start'}; {solution.objective:.6g}, IPOPT {best:.6g}; "
        + str(solution.status)[:90],
    )


def problems(families: Sequence[str], seeds: Sequence[int]) -> Iterator[tuple[str, object]]:
    """(Kind, problem) of all seeds of some families."""
    for family in families:
        for seed in seeds:
            given = problem(family, seed)
            yield "without limits", given
            limited = constrained(given)
            if limited is not None:
                yield "with limits", limited


def figures(
    families: Sequence[str] = tuple(FAMILIES), seeds: Sequence[int] = SEEDS
) -> Iterator[Figure]:
    """Shares of all problems, and the median of CPU time, without and with limits."""
    rows: dict[str, list[ArrayLayout]] = {"without limits": [], "with limits": []}
    for kind, given in problems(families, seeds):
        row = measure(given)
        if row is None:
            continue
        rows[kind].append(row)
        if not (row.best and row.coarse) or row.false:
            print(f"{row.name}: certified {row.certified}, {row.remark}", file=sys.stderr)
    for kind, found in rows.items():
        yield from _shares(kind, found)


def _shares(kind: str, rows: list[ArrayLayout]) -> Iterator[Figure]:
    """Figures of the problems of a kind."""
    kind = f"random problems {kind}"
    count, certified = len(rows), sum(row.certified for row in rows)
    yield Figure(name=f"{kind}: certified", value=f"{certified} of {count}",
                 good=certified >= 157 / 160 * count)  # fmt: skip
    best = sum(row.best for row in rows)
    yield Figure(name=f"{kind}: at the best optimum known", value=f"{best} of {count}",
                 good=best >= 152 / 160 * count)  # fmt: skip
    coarse = sum(row.coarse for row in rows)
    yield Figure(name=f"{kind}: networks settle, from the line or few stages of the path",
                 value=f"{coarse} of {certified}", good=coarse >= 0.95 * certified)  # fmt: skip
    false = sum(row.false for row in rows)
    yield Figure(name=f"{kind}: false certificates", value=str(false), good=not false)
    seconds = np.median([row.seconds for row in rows])
    yield Figure(name=f"{kind}: CPU time, median", value=f"{seconds:.2f} s", good=seconds <= 2.0,
                 remark=f"largest {max(row.seconds for row in rows):.1f} s")  # fmt: skip
    late = max(row.late for row in rows)
    yield Figure(name=f"{kind}: longest call over its limit", value=f"{max(late, 0.0):.1f} s",
                 good=late <= 1.0)  # fmt: skip


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("families", nargs="*", metavar="FAMILY", help=", ".join(FAMILIES))
    parser.add_argument("--seeds", type=int, default=len(SEEDS))
    given = parser.parse_args()
    sys.exit(show(figures(given.families or tuple(FAMILIES), range(given.seeds))))
