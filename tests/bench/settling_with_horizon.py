"""Settling time over the number of stages, by preconditioner.

Car, double integrator and Van der Pol at N = 9 ... 144 over the same horizon in seconds: settling
of the frozen network to a relative KKT residual of 1e-6, in fastest time constants, measured. All
are what `design` gives for the kinds of preconditioner that are named.
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from collections.abc import Iterator
from functools import partial

import numpy as np
from bench.figure import Figure, show

import ann_dc
from ann_dc.analysis.spectra import spectrum
from ann_dc.network.preconditioners.base import PreconditionerKind

STAGES = (9, 18, 36, 72, 144)
CHOICES = {
    "all kinds": tuple(PreconditionerKind),
    "multilevel": (PreconditionerKind.MULTILEVEL,),
    "diagonal": (PreconditionerKind.DIAGONAL,),
}
PLANTS = {
    "car": (ann_dc.plants.car, 0.9),
    "double integrator": (ann_dc.plants.double_integrator, 2.0),
    "Van der Pol": (ann_dc.plants.van_der_pol, 4.0),
}


def settling(network) -> float:
    """Measured settling in fastest time constants; nan if it does not settle."""
    run = ann_dc.OdeBackend(verify=False).run(network)
    return run.settling_time * spectrum(network, run.trajectory.final).radius


def figures() -> Iterator[Figure]:
    """One a plant and choice of kinds."""
    stages = ", ".join(str(N) for N in STAGES)
    for name, (plant, seconds) in PLANTS.items():
        networks = [ann_dc.synthesize(partial(plant, N=N, dt=seconds / N)()) for N in STAGES]
        for choice, kinds in CHOICES.items():
            found = [
                settling(ann_dc.design(network, preconditioner=kinds).network)
                for network in networks
            ]
            settled = [time for time in found if np.isfinite(time)]
            yield Figure(
                name=f"{name}, {choice}, N = {stages}",
                value=", ".join(f"{s:.0f}" if np.isfinite(s) else "never" for s in found),
                remark=f"tau_min; largest over smallest {max(settled) / min(settled):.2f}",
            )


if __name__ == "__main__":
    raise SystemExit(show(figures()))
