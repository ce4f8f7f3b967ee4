"""Peak memory of a batch: 100,000 cars in float32 have to fit in 4 GB.

Every figure is the largest resident size of a process of its own. The peak does not depend on how
many steps are taken, but on whether samples leave: those that stay are copied. So the tolerance is
set, by a small batch before, such that half of the cars leave within the few steps that are taken.
What a sample costs is the slope between a batch and one of twice its size; a neuron's share of it
must not grow with the horizon.
"""

import argparse
import resource
import subprocess
import sys
from collections.abc import Iterator

from bench.figure import Figure, show

SAMPLES = 100_000
SWEEPS = {False: 20_000, True: 5_000}
"""Smaller of the two batches between which the slope is taken, without and with acceleration."""
HORIZONS = (9, 18, 36)
STEPS = 10
PILOT = 200
"""Cars by which the tolerance is set."""
BAR = 4.0
"""GB that the process may take without acceleration."""


def settle(samples: int, horizon: int, accelerated: bool) -> None:
    """Step a batch of cars with other targets; print neurons, samples that left, peak in GB."""
    import numpy as np
    import torch

    import ann_dc
    from ann_dc.analysis.linearisation import Linearisation
    from ann_dc.gain_design.gain_rule import MULTILEVEL_RULE, closed_form
    from ann_dc.gain_design.gains import apply_gains

    plain = ann_dc.synthesize(ann_dc.plants.car(N=horizon, dt=0.9 / horizon))
    linear = Linearisation(plain).at(plain.start_state)
    network = apply_gains(plain, closed_form(linear, MULTILEVEL_RULE))
    acceleration = ann_dc.Anderson() if accelerated else None
    layer = ann_dc.RecurrentLayer(network, acceleration=acceleration, dtype=torch.float32)
    targets = np.random.default_rng(0).uniform(4, 6, (2, samples))
    inputs = {"q_d.x": targets[0], "q_d.y": targets[1]}

    checks: list[torch.Tensor] = []
    layer.settle(
        inputs={name: values[:PILOT] for name, values in inputs.items()},
        limit=STEPS,
        observe=lambda _, residuals, __: checks.append(residuals.amax(0)),
    )
    middle = float(torch.stack(checks[1:-1]).amin(0).quantile(0.6))
    few = ann_dc.Settling(tolerance=middle, confirm=1.0)
    ended = layer.settle(inputs=inputs, settling=few, limit=STEPS)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e9
    print(network.size, int(ended.settled.sum()), peak)


def measured(samples: int, horizon: int, accelerated: bool) -> tuple[int, int, float]:
    """(neurons, samples that left, peak in GB) of a batch in a process of its own."""
    arguments = [str(samples), str(horizon), *(["--accelerated"] if accelerated else [])]
    command = [sys.executable, "-m", "bench.batch_memory", *arguments]
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True)
    if done.returncode != 0:  # killed for its memory, perhaps
        return 0, 0, float("nan")
    neurons, left, peak = done.stdout.split()[-3:]
    return int(neurons), int(left), float(peak)


def figures() -> Iterator[Figure]:
    """The whole batch, and what a sample costs at every horizon, without and with acceleration."""
    for accelerated, sweep in SWEEPS.items():
        kind = "accelerated" if accelerated else "plain"
        _, left, peak = measured(SAMPLES, HORIZONS[0], accelerated)
        yield Figure(
            name=f"memory of {SAMPLES} cars, {kind}",
            value=f"{peak:.2f} GB",
            remark=f"{left} left on the way",
            good=accelerated or peak < BAR,
        )
        for horizon in HORIZONS:
            _, _, less = measured(sweep, horizon, accelerated)
            neurons, _, peak = measured(2 * sweep, horizon, accelerated)
            each = 1e9 * (peak - less) / sweep
            yield Figure(
                name=f"memory of a sample, {kind}, N = {horizon}",
                value=f"{each / 1e3:.1f} kB",
                remark=f"{each / max(neurons, 1):.0f} bytes a neuron",
            )


def main() -> int:
    """Measure one batch in this process, or show every figure."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("samples", nargs="?", type=int, help="measure this batch alone")
    parser.add_argument("horizon", nargs="?", type=int, default=HORIZONS[0])
    parser.add_argument("--accelerated", action="store_true")
    options = parser.parse_args()
    if options.samples is None:
        return show(figures())
    settle(options.samples, options.horizon, options.accelerated)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
