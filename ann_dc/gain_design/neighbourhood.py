"""Sampled neighbourhood in which a network with fixed gains settles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ann_dc.evaluation.codegen.evaluator import fast_evaluator
from ann_dc.evaluation.rules import SETTLED
from ann_dc.gain_design.procedure import Design
from ann_dc.gain_design.trial_run import PATIENCE, TOLERANCE, TRANSIENT, Pace, run_with_constants
from ann_dc.network.network import Network
from ann_dc.progress import Progress, silent
from ann_dc.validation import checked

SHARES = (0.05, 0.15)
"""Deviations of initial guesses and initial states, relative to each neuron's range."""
SAMPLES = 8
"""Samples per deviation."""


@dataclass(frozen=True, kw_only=True)
class Neighbourhood:
    """Number of sampled initial guesses and states from which a network settles.

    `starts` contains pairs of the standard deviation of the initial primal neurons, relative to
    their ranges, and how many of `SAMPLES` runs settled. `inputs` contains the same for the initial
    state q_0; empty if the network has no such input.
    """

    starts: tuple[tuple[float, int], ...]
    inputs: tuple[tuple[float, int], ...]

    def __str__(self) -> str:
        reported = []
        for what, found in (("starts", self.starts), ("initial states", self.inputs)):
            counts = " and ".join(f"{n} of {SAMPLES} at {share:.0%}" for share, n in found)
            reported += (
                [f"{what} perturbed by a fraction of the range of the trajectory: {counts} settle"]
                if found
                else []
            )
        return "; ".join(reported)


@checked
def neighbourhood(design: Design, *, seed: int = 0, progress: Progress = silent) -> Neighbourhood:
    """Run a designed network from initial guesses and states around the nominal ones.

    The network must settle; `seed` seeds the samples. `progress` receives one line per sample.

    Examples
    --------
    >>> from ann_dc import design, plants
    >>> print(neighbourhood(design(plants.double_integrator(N=5))).starts)
    ((0.05, 8), (0.15, 8))
    """
    network, rng = design.network, np.random.default_rng(seed)
    values = network.unpack(design.state)
    span = np.ptp(np.where(network.live, values, values.mean(axis=1, keepdims=True)), axis=1)
    starts, inputs = [], []
    names = [name for name in network.inputs if name.startswith("q_0.")]
    for share in SHARES:
        noise = [share * rng.standard_normal(network.live.shape) for _ in range(SAMPLES)]
        moved = [
            network.pack(network.unpack(network.start_state) + span[:, None] * n) for n in noise
        ]
        there = [network.with_start(state) for state in moved]
        starts.append((share, _settled(design, there, progress)))
        if names:
            there = [network.with_inputs(_moved(network, names, span, share, rng)) for _ in noise]
            inputs.append((share, _settled(design, there, progress)))
    return Neighbourhood(starts=tuple(starts), inputs=tuple(inputs))


def _moved(network: Network, names: list[str], span, share: float, rng) -> dict[str, float]:
    """Return initial states, each moved by a fraction of the range of its neuron."""
    moved = {}
    for name in names:
        neuron = network.neuron_index["q." + name.removeprefix("q_0.")]
        factor = network.cell.neurons[neuron].scale.factor
        moved[name] = network.inputs[name] + share * span[neuron] * factor * rng.standard_normal()
    return moved


def _settled(design: Design, networks: list[Network], progress: Progress) -> int:
    """Return the number of networks that settle within the time limit of a trial run."""
    pace, count = Pace.of(design.spectrum), 0
    limit = TRANSIENT + PATIENCE * design.best.ratio * np.log(1 / TOLERANCE)
    for number, network in enumerate(networks, 1):
        progress(f"neighbourhood: sample {number} of {len(networks)}")
        x = network.start_state.copy()
        _, outcome = run_with_constants(
            fast_evaluator(network), x, pace, limit=limit, tolerance=TOLERANCE
        )
        count += outcome == SETTLED
    return count
