"""The suite: 23 problems x 5 starts, design runs and frozen networks.

Every problem is designed from the line, from zeros, and from three seeded random starts, with
nothing tuned per problem. A run counts when it settles to a certified second-order KKT point.
Counted beside it: objectives of the best of six IPOPT starts (or cheaper), and those of optima that
many starts of IPOPT find (or cheaper). The frozen network of the line start then runs in
continuous time from that start. Failures are listed, not hidden.
"""

import argparse
import os
import sys
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # two processes share two cores

from bench.figure import Figure, show
from literature import LITERATURE
from problems import SUITE
from reference import best_of
from rich.console import Console
from rich.table import Table

import ann_dc
from ann_dc.gain_design.procedure import Design
from ann_dc.solution.solution import certificate_of

STARTS = ("line", "zeros", "random 0", "random 1", "random 2")

IPOPT_STARTS = 6

PROBLEMS = SUITE | LITERATURE
"""What may be asked for by name; without names, the suite alone is run."""


@dataclass(frozen=True)
class ArrayLayout:
    """One problem: what its five design runs and its frozen network did."""

    name: str
    designs: tuple[str, ...]
    certified: int
    best: int
    known: int
    own: int
    frozen: bool
    objective: float
    ratio: float
    settling: float
    predicted: float
    trial_settling: float
    steps: int
    seconds: float
    remark: str


def start(problem, name: str):
    """The start of that name."""
    if name == "line":
        return ann_dc.interpolated_guess(problem)
    if name == "zeros":
        return ann_dc.zero_guess(problem)
    return ann_dc.random_guess(problem, int(name.split()[1]))


def is_known(objective: float, optima: tuple[float, ...]) -> bool:
    """Tell if an objective is one of some optima (to the digits given) or below the best."""
    near = any(abs(objective - best) <= 2e-4 * max(abs(best), 0.25) for best in optima)
    return near or objective < min(optima)


def measure(name: str) -> ArrayLayout:
    """Design a problem from every start and run the frozen network of the first."""
    entry, problem = PROBLEMS[name], PROBLEMS[name].problem
    least = best_of(problem, IPOPT_STARTS).objective
    began = time.perf_counter()
    meaning, remark = [], []
    certified = best = known = own = 0
    first: Design | None = None
    for label in STARTS:
        network = ann_dc.synthesize(problem, initial_guess=start(problem, label))
        designed = ann_dc.design(network)
        first = first or designed
        found = certificate_of(problem, network, designed.state)
        good = designed.settled and found.second_order and found.kkt_residual < 1e-6
        certified += good
        best += good and is_known(found.objective, (least,))
        is_ipopts = good and is_known(found.objective, entry.optima)
        is_own = good and not is_ipopts and is_known(found.objective, entry.optima + entry.own)
        known, own = known + is_ipopts, own + is_own
        meaning.append(f"{found.objective:.4f}" if good else "FAILED")
        if not good:
            remark.append(f"design from {label} failed")
        elif not (is_ipopts or is_own):
            remark.append(f"{label}: {found.objective:.4f} is not in the table")
    run = ann_dc.OdeBackend(verify=False).run(first.network)
    end = certificate_of(problem, first.network, run.trajectory.final)
    frozen = run.status.settled and end.second_order
    if not frozen:
        remark.append(f"frozen: {run.status}")
    return ArrayLayout(
        name=name, designs=tuple(meaning), certified=certified, best=best, known=known, own=own,
        frozen=frozen, objective=end.objective, ratio=first.spectrum.stiffness_ratio,
        settling=run.settling_time * first.spectrum.radius,
        predicted=first.predicted_settling() * first.spectrum.radius,
        trial_settling=first.best.settling, steps=run.steps,
        seconds=time.perf_counter() - began, remark="; ".join(remark),
    )  # fmt: skip


def table(rows: Sequence[ArrayLayout]) -> Table:
    """One row a problem."""
    columns = ("frozen E", "ratio", "settling", "predicted", "steps", "s")
    found = Table("problem", "certified", "known", *STARTS, *columns)
    found.title = "settling in fastest time constants"
    for row in rows:
        found.add_row(
            row.name, f"{row.certified}/5", f"{row.known}/5", *row.designs,
            f"{row.objective:.4f}" if row.frozen else "FAILED", f"{row.ratio:.1f}",
            f"{row.settling:.0f}", f"{row.predicted:.0f}", str(row.steps),
            f"{row.seconds:.0f}")  # fmt: skip
    return found


def figures(names: Sequence[str] = tuple(SUITE), processes: int = 2) -> Iterator[Figure]:
    """How many settle; the table of all problems is printed. Bars hold for the whole suite."""
    rows = []
    with ProcessPoolExecutor(processes) as pool:
        for row in pool.map(measure, names):
            rows.append(row)
            print(f"{row.name}: {row.certified}/5 in {row.seconds:.0f} s", file=sys.stderr)
    Console(width=200).print(table(rows))
    whole = len(rows) == len(SUITE)
    certified, frozen = sum(r.certified for r in rows), sum(r.frozen for r in rows)
    yield Figure(
        name=f"design runs settled and certified, {len(rows)} problems x {len(STARTS)} starts",
        value=f"{certified} of {len(STARTS) * len(rows)}",
        remark=f"best of {IPOPT_STARTS} IPOPT starts or cheaper {sum(r.best for r in rows)}, "
        f"another optimum that IPOPT finds {sum(r.known - r.best for r in rows)}, "
        f"one that the network found first {sum(r.own for r in rows)}",
        good=not whole or certified >= 112,
    )
    yield Figure(
        name="frozen networks settled in continuous time",
        value=f"{frozen} of {len(rows)}",
        good=not whole or frozen >= 20,
    )
    for row in rows:
        yield Figure(
            name=f"{row.name}: settling to 1e-6",
            value=f"{row.settling:.0f} tau_min",
            remark="; ".join(filter(None, (f"predicted {row.predicted:.0f}", row.remark))),
        )


def main() -> int:
    """Print the table; exit code 1 if a bar is missed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", default=list(SUITE), help="problems; all by default")
    parser.add_argument("--processes", type=int, default=2)
    options = parser.parse_args()
    return show(figures(options.names, options.processes))


if __name__ == "__main__":
    raise SystemExit(main())
