"""Peak memory of a batch: 100,000 cars in float32 have to fit in 4 GB. `make bench`.

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
    from ann_dc.gain_design.gains import apply_gains
    from ann_dc.gain_design.recipe import WITH_COORDINATORS, closed_form

    plain = ann_dc.synthesize(ann_dc.plants.car(N=horizon, dt=0.9 / horizon))
    linear = Linearisation(plain).at(plain.start_state)
    network = apply_gains(plain, closed_form(linear, WITH_COORDINATORS))
    acceleration = ann_dc.Anderson() if accelerated else None
    layer = ann_dc.RecurrentLayer(network, acceleration=acceleration, dtype=torch.float32)
    targets = np.random.default_rng(0).uniform(4, 6, (2, samples))
    inputs = {"q_d.x": targets[0], "q_d.y": targets[1]}

    looks: list[torch.Tensor] = []
    layer.settle(
        inputs={name: values[:PILOT] for name, values in inputs.items()},
        limit=STEPS,
        observe=lambda loop, residuals: looks.append(residuals.amax(0)),
    )
    middle = float(torch.stack(looks[1:-1]).amin(0).quantile(0.6))
    few = ann_dc.Settling(tolerance=middle, confirm=1.0)
    ended = layer.settle(inputs=inputs, settling=few, limit=STEPS)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e9
    print(network.size, int(ended.settled.sum()), peak)


def measured(samples: int, horizon: int, accelerated: bool) -> tuple[int, int, float]:
    """(neurons, samples that left, peak in GB) of a batch in a process of its own."""
    arguments = [str(samples), str(horizon), *(["--accelerated"] if accelerated else [])]
    done = subprocess.run([sys.executable, __file__, *arguments], stdout=subprocess.PIPE, text=True)
    if done.returncode != 0:  # killed for its memory, perhaps
        return 0, 0, float("nan")
    neurons, left, peak = done.stdout.split()[-3:]
    return int(neurons), int(left), float(peak)


def main() -> int:
    """Print the table; exit code 1 if the bar is missed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("samples", nargs="?", type=int, help="measure this batch alone")
    parser.add_argument("horizon", nargs="?", type=int, default=HORIZONS[0])
    parser.add_argument("--accelerated", action="store_true")
    options = parser.parse_args()
    if options.samples is not None:
        settle(options.samples, options.horizon, options.accelerated)
        return 0
    print(f"{'':12} {'samples':>8} {'left':>8} {'GB':>6}   N  neurons  kB a sample  bytes a neuron")
    whole = {}
    for accelerated, sweep in SWEEPS.items():
        name = "accelerated" if accelerated else "plain"
        _, left, peak = measured(SAMPLES, HORIZONS[0], accelerated)
        whole[accelerated] = peak
        print(f"{name:12} {SAMPLES:8} {left:8} {peak:6.2f} {HORIZONS[0]:3}", flush=True)
        for horizon in HORIZONS:
            _, _, less = measured(sweep, horizon, accelerated)
            neurons, left, peak = measured(2 * sweep, horizon, accelerated)
            each = 1e9 * (peak - less) / sweep
            print(
                f"{name:12} {2 * sweep:8} {left:8} {peak:6.2f} {horizon:3} {neurons:8} "
                f"{each / 1e3:12.1f} {each / max(neurons, 1):15.0f}",
                flush=True,
            )
    good = whole[False] < BAR
    print(f"{SAMPLES} cars {'' if good else 'do NOT '}fit in {BAR:g} GB")
    return int(not good)


if __name__ == "__main__":
    raise SystemExit(main())
