"""Recurrent steps to a relative KKT residual of 1e-6, for every way of stepping.

Each problem of the suite is designed once from the straight line; beside it stands the paper's car
with a pyramid, its gains refined for steps of the simultaneous and of the two-phase order. Then its
network takes steps: at the best of 32 fixed h (shares of the largest stable step of the
simultaneous order, which only the spectrum at the solution tells), with the adaptive rule, which is
told nothing, and accelerated. A number counts when the end is a certified optimum; what ends
otherwise is listed.
"""

import argparse
import os
import sys
import time
import warnings
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # two processes share two cores
os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
import torch
from bench.figure import Figure, show
from problems import SUITE
from rich.console import Console
from rich.table import Table

import ann_dc
from ann_dc.backends.run import Run
from ann_dc.backends.status import Outcome
from ann_dc.network.preconditioners.base import ALL_KINDS
from ann_dc.solution.solution import certificate_of

SHARES = np.concatenate([np.linspace(0.3, 0.98, 20), np.geomspace(1.1, 6.0, 12)])
"""Fixed steps that are tried, as shares of the largest stable simultaneous one."""
PATIENCE = 3
"""How often as many steps as the adaptive rule takes a fixed step may take."""
LONGEST_SWEEP = 40
"""Horizon above which stage by stage, N cells in a row each step, is left out."""
REFINED = {"car for steps": ann_dc.STEPS, "car for two-phase steps": ann_dc.TWO_PHASE_STEPS}
"""The paper's car with a pyramid, and what its gains are refined for."""
BARS = {
    "car for steps": {"fixed": 240, "accelerated": 60},
    "car for two-phase steps": {"two-phase fixed": 120},
}
"""Steps at most."""
FIXED = {"fixed": ann_dc.SIMULTANEOUS, "two-phase fixed": ann_dc.TWO_PHASE}
ACCELERATED = ("accelerated", "two-phase accelerated")
WAYS = {
    "adaptive": ann_dc.RecurrentBackend(),
    "two-phase adaptive": ann_dc.RecurrentBackend(order=ann_dc.TWO_PHASE),
    "stage by stage": ann_dc.RecurrentBackend(order=ann_dc.STAGE_BY_STAGE),
    "accelerated": ann_dc.RecurrentBackend(acceleration=ann_dc.Anderson()),
    "two-phase accelerated": ann_dc.RecurrentBackend(
        order=ann_dc.TWO_PHASE, acceleration=ann_dc.Anderson()
    ),
}
COLUMNS = ("fixed", "adaptive", "two-phase fixed", *list(WAYS)[1:])


@dataclass(frozen=True)
class End:
    """How one way of stepping ended; ``share`` is that of the best fixed step."""

    outcome: Outcome
    steps: int
    certified: bool
    objective: float
    share: float = float("nan")

    def __str__(self) -> str:
        if self.outcome is not Outcome.SETTLED:
            return "LIMIT" if self.outcome is Outcome.NOT_SETTLED else self.outcome.name
        meaning = f"{self.steps}" if np.isnan(self.share) else f"{self.steps} @{self.share:.2f}"
        return meaning if self.certified else f"{meaning} (!)"


@dataclass(frozen=True)
class ArrayLayout:
    """One problem and how every way of stepping ended on it."""

    name: str
    stages: int
    neurons: int
    designed: float
    ends: dict[str, End]
    seconds: float


def measure(name: str, limit: int) -> ArrayLayout:
    """Design a problem and step its network in every way."""
    torch.set_num_threads(1)
    began = time.perf_counter()
    problem = SUITE[name.partition(" ")[0]].problem
    kinds = [ann_dc.PreconditionerKind.MULTILEVEL] if name in REFINED else ALL_KINDS
    designed = ann_dc.design(problem, preconditioner=kinds, refine=REFINED.get(name))
    network = designed.network

    def end(run: Run, share: float = float("nan")) -> End:
        found = certificate_of(problem, network, run.trajectory.final)
        steps = run.steps if run.settling_steps is None else run.settling_steps
        return End(run.status.outcome, steps, found.certified, found.objective, share)

    def best_fixed(order, most: int) -> End:
        ends = []
        for share in SHARES.tolist():
            step = ann_dc.FixedStep(step=share * designed.spectrum.largest_step)
            backend = ann_dc.RecurrentBackend(order=order, step=step, limit=most)
            with warnings.catch_warnings(action="ignore"):  # some are too long, and meant to be
                ends.append(end(backend.run(network), share))
        return min(ends, key=lambda end: (end.outcome is not Outcome.SETTLED, end.steps))

    ends: dict[str, End] = {}
    for way, backend in WAYS.items():
        if way != "stage by stage" or network.stages <= LONGEST_SWEEP:
            ends[way] = end(replace(backend, limit=limit).run(network))
    meaning = ends["adaptive"]
    most = PATIENCE * meaning.steps if meaning.outcome is Outcome.SETTLED else limit
    ends |= {way: best_fixed(order, min(most, limit)) for way, order in FIXED.items()}
    designed_for = certificate_of(problem, network, designed.state).objective
    seconds = time.perf_counter() - began
    return ArrayLayout(name, network.stages, network.size, designed_for, ends, seconds)


def remarks(row: ArrayLayout):
    """What is not as it should be, a line each."""
    for way, end in row.ends.items():
        if end.outcome is not Outcome.SETTLED:
            yield f"{row.name}, {way}: {end.outcome.value}"
        elif not end.certified:
            yield f"{row.name}, {way}: settled, not certified, E = {end.objective:.6g}"
        elif abs(end.objective - row.designed) > 1e-6 * abs(row.designed):
            yield f"{row.name}, {way}: another optimum, E = {end.objective:.6g}"


def is_good(row: ArrayLayout, way: str) -> bool:
    """Whether a way meets its bars: steps of the refined cars, certified when accelerated."""
    end, bar = row.ends[way], BARS.get(row.name, {}).get(way, np.inf)
    certified = end.certified or (way not in ACCELERATED and bar == np.inf)
    return certified and end.steps <= bar


def table(rows: Sequence[ArrayLayout]) -> Table:
    """One row a problem."""
    found = Table("problem", "N", "neurons", "E", *COLUMNS, "s")
    found.title = "recurrent steps to 1e-6; @ share of the largest stable simultaneous step"
    for row in rows:
        ends = [str(row.ends[way]) if way in row.ends else "skipped" for way in COLUMNS]
        found.add_row(
            row.name, str(row.stages), str(row.neurons), f"{row.designed:.4f}", *ends,
            f"{row.seconds:.0f}")  # fmt: skip
    return found


def figures(
    names: Sequence[str] = (*REFINED, *SUITE), limit: int = 20_000, processes: int = 2
) -> Iterator[Figure]:
    """Steps of the cars, and how many of each way are certified; the table is printed."""
    rows: list[ArrayLayout] = []
    with ProcessPoolExecutor(processes) as pool:
        for row in pool.map(measure, names, [limit] * len(names)):
            rows.append(row)
            print(f"{row.name}: {row.seconds:.0f} s", file=sys.stderr)
    console = Console(width=200)
    console.print(table(rows))
    console.print(
        f"skipped: N > {LONGEST_SWEEP}; LIMIT: {limit} steps, or {PATIENCE} times those of "
        "the adaptive rule; (!): not certified")  # fmt: skip
    for row in rows:
        for way in (way for way in COLUMNS if way in row.ends):
            good = is_good(row, way)
            if row.name in ("car", *REFINED) or not good:
                value = str(row.ends[way])
                yield Figure(name=f"steps of {row.name}, {way}", value=value, good=good)
    for way in COLUMNS:
        ends = [row.ends[way] for row in rows if way in row.ends]
        count = sum(e.certified for e in ends)
        yield Figure(name=f"certified, {way}", value=f"{count} of {len(ends)}")
    for line in (line for row in rows for line in remarks(row)):
        console.print(line)


def main() -> int:
    """Print the table; exit code 1 if a bar is missed."""
    parser = argparse.ArgumentParser(description=__doc__)
    everything = [*REFINED, *SUITE]
    parser.add_argument("names", nargs="*", default=everything, help="problems; all by default")
    parser.add_argument("--limit", type=int, default=20_000, help="largest number of steps")
    parser.add_argument("--processes", type=int, default=2)
    options = parser.parse_args()
    return show(figures(options.names, options.limit, options.processes))


if __name__ == "__main__":
    raise SystemExit(main())
