"""Designs: stiffness ratio and settling time, with all preconditioners and with two kinds.

Every problem is designed twice, with all kinds of preconditioner and without grid and tree, and the
frozen network runs in continuous time from the line. The geometric means are over the problems that
the study of preconditioners had, orbit transfer with 50 stages among them.
"""

import argparse
import os
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # two processes share two cores

import numpy as np
from bench.figure import Figure, show
from literature import LITERATURE
from problems import SUITE

import ann_dc
from ann_dc.network.preconditioners.base import ALL_KINDS, PreconditionerKind
from ann_dc.problem import plants
from ann_dc.solution.solution import certificate_of

WIRINGS = {
    "all kinds": ALL_KINDS,
    "multilevel": (
        PreconditionerKind.MULTILEVEL,
        PreconditionerKind.COUPLED_MULTILEVEL,
        PreconditionerKind.DIAGONAL,
    ),
}
BARS = {"all kinds": 5.5, "multilevel": 15.0}
"""Of the geometric means."""
PROBLEMS = {name: entry.build for name, entry in (SUITE | LITERATURE).items()}
PROBLEMS["orbit_N50"] = partial(plants.orbit_transfer, N=50)
STUDIED = [
    "car",
    "car_D.5",
    "unicycle",
    "bicycle",
    "van_der_pol",
    "pendulum",
    "cstr",
    "planar_quadrotor",
    "two_link_arm",
    "orbit_N50",
    "cart_pole",
]


def of_problem(name: str) -> list[tuple[str, float, Figure]]:
    """Wiring, ratio and figure, one a wiring."""
    problem, found = PROBLEMS[name](), []
    for wiring, kinds in WIRINGS.items():
        designed = ann_dc.design(problem, preconditioner=kinds)
        run = ann_dc.OdeBackend(verify=False).run(designed.network)
        certificate = certificate_of(problem, designed.network, run.trajectory.final)
        certified = run.status.settled and certificate.certified
        taus = run.settling_time * designed.spectrum.radius if certified else float("nan")
        figure = Figure(
            name=f"{name}, {wiring}",
            value=f"{taus:.0f} tau_min",
            remark=f"ratio {designed.spectrum.stiffness_ratio:.2f}, "
            f"{designed.best.kind.value}, "
            f"{designed.best.gain_rule.equilibration_sweeps} equilibration sweeps, "
            f"objective {certificate.objective:.4f}",
            good=certified,
        )
        found.append((wiring, designed.spectrum.stiffness_ratio, figure))
    return found


def figures(names: Sequence[str] = tuple(PROBLEMS), processes: int = 2) -> Iterator[Figure]:
    """Of some problems, as they come, and the geometric means."""
    ratios: dict[str, list[float]] = {wiring: [] for wiring in WIRINGS}
    with ProcessPoolExecutor(processes) as pool:
        for name, found in zip(names, pool.map(of_problem, names)):
            for wiring, ratio, figure in found:
                yield figure
                if name in STUDIED:
                    ratios[wiring].append(ratio)
    for wiring, given in ratios.items():
        mean = float(np.exp(np.mean(np.log(given)))) if given else float("nan")
        yield Figure(
            name=f"geometric mean of the ratio, {wiring}",
            value=f"{mean:.2f}",
            remark=f"{len(given)} problems; the limit is 2, the bar {BARS[wiring]}",
            good=not mean > BARS[wiring],
        )


def main() -> int:
    """Print the table; exit code 1 if a bar is missed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", default=list(PROBLEMS), help="all by default")
    parser.add_argument("--processes", type=int, default=2)
    options = parser.parse_args()
    return show(figures(options.names, options.processes))


if __name__ == "__main__":
    raise SystemExit(main())
