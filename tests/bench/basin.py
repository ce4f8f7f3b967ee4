"""Random initial guesses: networks with fixed gains from twenty guesses, by preconditioner.

Every kind of metric is designed from the line and frozen; the network then runs from seeded random
starts of the spread that the suite uses. A run is lost when it does not settle at a certified
optimum. What a metric gains in speed it must not pay for with the basin of the pyramid.
"""

import argparse
import os
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # two processes share two cores

import numpy as np
from bench.figure import Figure, show
from problems import SUITE

import ann_dc
from ann_dc.network.preconditioners.base import PreconditionerKind
from ann_dc.solution.solution import certificate_of

STARTS = 20
SHORT = [name for name, entry in SUITE.items() if entry.problem.horizon <= 50]
"""The problems of the suite with at most 50 stages."""
KINDS = (
    PreconditionerKind.DIAGONAL,
    PreconditionerKind.MULTILEVEL,
    PreconditionerKind.COUPLED_MULTILEVEL,
    PreconditionerKind.RESISTIVE_GRID,
)
"""A tree is the same metric as a grid."""


def lost(name: str, kind: PreconditionerKind) -> tuple[int, float]:
    """Return the number of lost starts and the median settling time in tau_min."""
    problem = SUITE[name].problem
    designed = ann_dc.design(problem, preconditioner=[kind])
    settling = []
    for seed in range(STARTS):
        start = ann_dc.synthesize(
            problem, initial_guess=ann_dc.random_guess(problem, seed)
        ).start_state
        run = ann_dc.OdeBackend(verify=False).run(designed.network.with_start(start))
        certificate = certificate_of(problem, designed.network, run.trajectory.final)
        if run.status.settled and certificate.certified:
            settling.append(run.settling_time * designed.spectrum.radius)
    return STARTS - len(settling), float(np.median(settling)) if settling else float("nan")


def of_problem(name: str) -> list[Figure]:
    """One figure a kind; the bar is what the pyramids lose."""
    found = {kind: lost(name, kind) for kind in KINDS}
    bar = max(
        found[kind][0]
        for kind in (PreconditionerKind.MULTILEVEL, PreconditionerKind.COUPLED_MULTILEVEL)
    )
    return [
        Figure(
            name=f"{name}, {kind.value}",
            value=f"{count} of {STARTS} not certified",
            remark=f"median settling time {median:.0f} tau_min",
            good=count <= bar or kind is PreconditionerKind.DIAGONAL,
        )
        for kind, (count, median) in found.items()
    ]


def figures(names: Sequence[str] = SHORT, processes: int = 2) -> Iterator[Figure]:
    """Of some problems, as they come."""
    with ProcessPoolExecutor(processes) as pool:
        for found in pool.map(of_problem, names):
            yield from found


def main() -> int:
    """Print the table; exit code 1 if a bar is missed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", default=SHORT, help="problems; all short by default")
    parser.add_argument("--processes", type=int, default=2)
    options = parser.parse_args()
    return show(figures(options.names, options.processes))


if __name__ == "__main__":
    raise SystemExit(main())
