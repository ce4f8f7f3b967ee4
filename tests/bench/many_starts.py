"""Initial guesses in one batch: known optima that are found, and time against single solves.

Single solves are `ann_dc.solve` from the first few of the same starts; their mean time counts 64
times. Seconds are CPU seconds of one core. The bar is a tenth.
"""

import time
from collections.abc import Iterator

import numpy as np
import torch
from bench.figure import Figure, show

import ann_dc
from ann_dc.families.seeded_starts import seeded_starts

STARTS, SINGLE = 64, 3
PROBLEMS = {
    "unicycle_soft_obstacle": (ann_dc.plants.unicycle_soft_obstacle, {}, (3.1306, 3.799)),
    "car_g3": (
        ann_dc.plants.car,
        {"q_d": (-2, 4, 1, 0)},
        (264.5928, 279.2, 280.1725, 288.2, 293.2838, 294.4514),
    ),
}
"""Plant, what is changed, and the optima that are known."""


def figures() -> Iterator[Figure]:
    """Two a problem: optima, and time."""
    torch.set_num_threads(1)
    ann_dc.solve(ann_dc.plants.double_integrator(N=5))  # everything is loaded and compiled
    for name, (plant, changed, known) in PROBLEMS.items():
        problem = plant(**changed)
        began = time.process_time()
        found = ann_dc.multistart(problem, STARTS)
        batch = time.process_time() - began
        objectives = np.array([optimum.objective for optimum in found.optima])
        met = [o for o in known if np.isclose(objectives, o, rtol=3e-4).any()]
        yield Figure(
            name=f"{name}: known optima met from {STARTS} starts",
            value=f"{len(met)} of {len(known)}",
            remark=f"certified: {', '.join(f'{o:.6g}' for o in objectives)}; "
            f"{found.unsettled} starts led to none",
            good=len(met) == len(known),
        )
        began = time.process_time()
        for start in seeded_starts(problem, SINGLE):
            ann_dc.solve(problem, initial_guess=start)
        single = (time.process_time() - began) / SINGLE
        share = batch / (STARTS * single)
        yield Figure(
            name=f"{name}: time relative to {STARTS} single solves",
            value=f"{share:.3f}",
            remark=f"{batch:.1f} s in one batch, {single:.2f} s a single solve",
            good=share <= 0.1,
        )


if __name__ == "__main__":
    raise SystemExit(show(figures()))
