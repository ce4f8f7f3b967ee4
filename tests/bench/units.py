"""Units: eight plants in random other units, designed again and run.

Factors are 10^U(-6, 6) on every state, every control, the cost and time. The network computes in
the problem's own scales: its settling may differ by 1 %, the steps of the design by 5 %, and what
it settles to, in the first units again, by 1e-4 of the largest value of a state or control.
"""

import argparse
from collections.abc import Iterator, Sequence

import numpy as np
from bench.figure import Figure, show
from other_units import Units, written_in
from problems import SUITE

import ann_dc

PLANTS = (
    "car",
    "unicycle",
    "bicycle",
    "double_integrator",
    "pendulum",
    "van_der_pol",
    "two_link_arm",
    "cstr",
)
SETTLING, STEPS, DEVIATION = 0.01, 0.05, 1e-4
"""Bars."""


def figure_of(name: str, seed: int) -> Figure:
    """One plant, in its own units and in others."""
    problem = SUITE[name].problem
    units = Units.random(problem, seed)
    ours, theirs = (
        ann_dc.solve(each, backend=ann_dc.OdeBackend(verify=False))
        for each in (problem, written_in(problem, units))
    )
    settling = theirs.normalised_settling_time / ours.normalised_settling_time
    steps = theirs.design.first.steps / ours.design.first.steps
    worst = deviation(problem, ours, theirs, units)
    certified = ours.certified and theirs.certified
    return Figure(
        name=f"{name} in random units: settling over that in its own",
        value=f"{settling:.4f}",
        remark=f"design steps {steps:.3f}; states and controls within {worst:.1e} of their largest"
        f"{'' if certified else '; not certified'}",
        good=certified
        and abs(settling - 1) <= SETTLING
        and abs(steps - 1) <= STEPS
        and worst <= DEVIATION,
    )


def deviation(problem, ours: ann_dc.Solution, theirs: ann_dc.Solution, units: Units) -> float:
    """Largest difference of a state or control, as a share of its largest value."""
    factors = [*units.state, *units.control]
    worst = 0.0
    for symbol, factor in zip((*problem.states, *problem.controls), factors, strict=True):
        own, other = ours[str(symbol)], factor * theirs[str(symbol)]
        worst = max(worst, float(np.abs(other - own).max() / np.abs(own).max()))
    return worst


def figures(names: Sequence[str] = PLANTS) -> Iterator[Figure]:
    """One a plant."""
    for seed, name in enumerate(names):
        yield figure_of(name, seed)


def main() -> int:
    """Print the table; exit code 1 if a bar is missed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", default=list(PLANTS), help="all by default")
    return show(figures(parser.parse_args().names))


if __name__ == "__main__":
    raise SystemExit(main())
