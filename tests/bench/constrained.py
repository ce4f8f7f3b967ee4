"""Inequalities: 26 problems with constraints and bounds, designed and run with fixed gains.

Every problem is solved with one setting, and the frozen network runs in continuous time from the
line, or from the presets that the row names. It counts when it settles to a certified optimum,
violation and complementarity included, whose objective IPOPT, started there, confirms to 1e-5.
Failures are listed, not hidden.
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
from constrained import CONSTRAINED
from reference import ipopt

import ann_dc

AGREE = 1e-5
"""Relative difference of objectives, at most; a better one counts too."""


@dataclass(frozen=True)
class ArrayLayout:
    """One problem: its first run, and its frozen network."""

    name: str
    first: bool
    steps: int
    frozen: bool
    settling: float
    remark: str
    seconds: float

    def figure(self) -> Figure:
        """Settling, beside the first run and what was settled to."""
        first = f"optimum {'known' if self.first else 'not known'} after {self.steps} steps"
        return Figure(
            name=f"{self.name}: settling to 1e-6",
            value=f"{self.settling:.0f} tau_min" if self.frozen else "never",
            remark=f"{first}; {self.remark}",
            number=self.settling if self.frozen else float("nan"),
        )


def measure(name: str) -> ArrayLayout:
    """Design a problem from the line and run the frozen network."""
    problem, began = CONSTRAINED[name].problem, time.perf_counter()
    answer = ann_dc.solve(problem, backend=ann_dc.OdeBackend(verify=False))
    designed, run, certificate = answer.design, answer.run, answer.certificate
    frozen, remark = run.status.settled and certificate.certified, str(run.status)
    if frozen:
        best = ipopt(problem, guess=(answer["q"].T, answer["u"].T)).objective
        apart = (certificate.objective - best) / abs(best)
        frozen = apart < AGREE
        remark = (
            f"{'certified' if frozen else 'NOT the optimum'}, E = {certificate.objective:.6g}, "
            f"{apart:+.0e} of it from IPOPT's; {certificate.complementarity.counts}; "
            f"ratio {designed.spectrum.stiffness_ratio:.1f}; from {designed.start or 'the line'}"
        )
    elif run.status.settled:
        remark = certificate.reason
    return ArrayLayout(
        name=name, first=designed.settled, steps=designed.first.steps, frozen=frozen,
        settling=run.settling_time * designed.spectrum.radius, remark=remark,
        seconds=time.perf_counter() - began,
    )  # fmt: skip


def figures(names: Sequence[str] = tuple(CONSTRAINED), processes: int = 2) -> Iterator[Figure]:
    """How many settle, then problem by problem. Bars hold for all of them."""
    rows = []
    with ProcessPoolExecutor(processes) as pool:
        for row in pool.map(measure, names):
            rows.append(row)
            print(f"{row.name}: {row.seconds:.0f} s", file=sys.stderr, flush=True)
    whole = len(rows) == len(CONSTRAINED)
    first, frozen = sum(row.first for row in rows), sum(row.frozen for row in rows)
    yield Figure(
        name="designs that know an optimum",
        value=f"{first} of {len(rows)}",
        good=not whole or first >= 22,
    )
    yield Figure(
        name="frozen networks that settle to a certified optimum",
        value=f"{frozen} of {len(rows)}",
        remark="never: " + (", ".join(row.name for row in rows if not row.frozen) or "none"),
        good=not whole or frozen >= 20,
    )
    yield from (row.figure() for row in rows)


def main() -> int:
    """Print the table; exit code 1 if a bar is missed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", default=list(CONSTRAINED), help="all by default")
    parser.add_argument("--processes", type=int, default=2)
    options = parser.parse_args()
    return show(figures(options.names, options.processes))


if __name__ == "__main__":
    raise SystemExit(main())
