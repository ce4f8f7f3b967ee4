"""Settling against the number of stages, with and without coarse coordinators.

Car, double integrator and Van der Pol at N = 9 ... 144 over the same horizon in seconds: settling
of the frozen network to a relative KKT residual of 1e-6, in fastest time constants, measured.
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from collections.abc import Iterator
from functools import partial

from bench.figure import Figure, show

import ann_dc
from ann_dc.analysis import Linearisation, spectrum
from ann_dc.gain_design import WITHOUT_COORDINATORS, apply_gains, closed_form

STAGES = (9, 18, 36, 72, 144)
PLANTS = {
    "car": (ann_dc.plants.car, 0.9),
    "double integrator": (ann_dc.plants.double_integrator, 2.0),
    "Van der Pol": (ann_dc.plants.van_der_pol, 4.0),
}


def settling(network) -> float:
    """Measured settling in fastest time constants; nan if it does not settle."""
    run = ann_dc.OdeBackend(verify=False).run(network)
    return run.settling_time * spectrum(network, run.trajectory.final).radius


def without(network, state, boost: float):
    """The network frozen without coordinators at a settled point; the best of three penalties."""
    linear = Linearisation(network).at(state)
    tried = [apply_gains(network, closed_form(linear, WITHOUT_COORDINATORS, boost * factor))
             for factor in (1, 2, 4)]  # fmt: skip
    return min(tried, key=lambda n: spectrum(n, state).ratio)


def figures() -> Iterator[Figure]:
    """Two a plant: with coordinators, and without."""
    stages = ", ".join(str(N) for N in STAGES)
    for name, (plant, seconds) in PLANTS.items():
        coordinated, bare = [], []
        for N in STAGES:
            network = ann_dc.synthesize(partial(plant, N=N, dt=seconds / N)())
            designed = ann_dc.design(network)
            coordinated.append(settling(designed.network))
            bare.append(settling(without(network, designed.state, designed.first.boost)))
        for kind, found in (("with coordinators", coordinated), ("neighbours only", bare)):
            yield Figure(
                name=f"{name} {kind}, N = {stages}",
                value=", ".join(f"{s:.0f}" for s in found),
                remark=f"largest over smallest {max(found) / min(found):.2f}",
            )


if __name__ == "__main__":
    raise SystemExit(show(figures()))
