"""Operating ranges: one network for a thousand held-out inputs, on six plants.

A single design belongs to the plant's own inputs; its settling is that of the frozen network from
the straight line. The bars are 99 of 100 held-out inputs certified, within 4 times that settling.
"""

import argparse
import time
from collections.abc import Iterator, Sequence

import numpy as np
from bench.figure import Figure, show

import ann_dc
from ann_dc.families.family_design import design_family

HELD_OUT = 1000
SHARE, SLOWER = 0.99, 4.0
"""Bars."""
HANGING = np.pi
FAMILIES = {
    "car": {
        "q_d.x": (3, 7),
        "q_d.y": (3, 7),
        "q_d.phi": (-0.5, 0.5),
        "q_0.x": (-1, 1),
        "q_0.y": (-1, 1),
        "q_0.phi": (-0.5, 0.5),
    },
    "unicycle": {
        "q_d.x": (1, 3),
        "q_d.y": (0.5, 2),
        "q_d.theta": (-0.5, 0.5),
        "q_0.x": (-0.5, 0.5),
        "q_0.y": (-0.5, 0.5),
        "q_0.theta": (-0.5, 0.5),
    },
    "pendulum": {"q_0.theta": (HANGING - 0.5, HANGING + 0.5), "q_0.omega": (-1, 1)},
    "planar_quadrotor": {
        "q_d.x": (0.5, 1.5),
        "q_d.y": (0.5, 1.5),
        "q_0.x": (-0.3, 0.3),
        "q_0.theta": (-0.3, 0.3),
        "q_0.v_x": (-0.5, 0.5),
    },
    "two_link_arm": {
        "q_d.shoulder": (0.6, 1.4),
        "q_d.elbow": (0.8, 1.6),
        "q_0.shoulder": (-0.3, 0.3),
        "q_0.elbow": (0.2, 0.8),
    },
    "van_der_pol": {"q_0.x": (-1.5, 1.5), "q_0.v": (-1, 1)},
}
"""Ranges of inputs, by plant."""


def of_plant(name: str, held_out: int) -> Iterator[Figure]:
    """Share and settling of one family."""
    problem = ann_dc.plants.get(name)()
    single = ann_dc.solve(problem, backend=ann_dc.OdeBackend(verify=False))
    alone = single.normalised_settling_time
    began = time.process_time()
    designed = design_family(problem, FAMILIES[name], held_out=held_out)
    took = time.process_time() - began
    found = designed.validation
    low, high = found.interval
    yield Figure(
        name=f"{name}: held-out inputs certified",
        value=f"{found.share:.1%}",
        remark=f"{found.certified.sum()} of {len(found)}, {low:.1%} to {high:.1%}; "
        f"{designed.winner.gain_rule.kind.value}, {took:.0f} s",
        good=found.share >= SHARE,
    )
    slowest = found.settling_quantile(0.99)
    yield Figure(
        name=f"{name}: 99 of 100 settle within, over a single design",
        value=f"{slowest / alone:.2f}",
        remark=f"{slowest:.0f} tau_min, median {found.settling_quantile(0.5):.0f}; "
        f"a single design {alone:.0f}",
        good=slowest <= SLOWER * alone,
    )


def figures(names: Sequence[str] = tuple(FAMILIES), held_out: int = HELD_OUT) -> Iterator[Figure]:
    """Two a plant."""
    for name in names:
        yield from of_plant(name, held_out)


def main() -> int:
    """Print the table; exit code 1 if a bar is missed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", default=list(FAMILIES), help="all by default")
    parser.add_argument("--held-out", type=int, default=HELD_OUT)
    options = parser.parse_args()
    return show(figures(options.names, options.held_out))


if __name__ == "__main__":
    raise SystemExit(main())
