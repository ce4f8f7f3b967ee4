"""Recurrent runs in layers: with acceleration, on a GPU, and for any wiring.

One or many runs are supported.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import torch

from ann_dc.backends.batch import BatchRecorder, BatchRun
from ann_dc.backends.integration.integrator import RUNNING
from ann_dc.backends.lane_batch import OUTCOMES
from ann_dc.backends.layers.ledger import Ledger
from ann_dc.backends.layers.loop import Loop
from ann_dc.backends.layers.recurrent_layer import RecurrentLayer
from ann_dc.backends.settling import Settling
from ann_dc.backends.status import Outcome
from ann_dc.network.inputs import input_batch
from ann_dc.progress import Progress


def run_batch(
    layer: RecurrentLayer,
    inputs: Mapping[str, object],
    x: np.ndarray | None,
    *,
    settling: Settling,
    limit: int,
    check: int,
    curves: int,
    progress: Progress,
) -> BatchRun:
    """Run a batch like `RecurrentBackend.run_batch`, checking every ``check`` steps."""
    network, recorder = layer.cell.network, BatchRecorder(curves)

    def record(loop: Loop, residuals: torch.Tensor, ledger: Ledger) -> None:
        running = ledger.open
        recorder.record(
            ledger.samples[running].cpu().numpy(),
            loop.time[running].cpu().numpy(),
            loop.cell.pack(loop.state[..., running]).cpu().numpy(),
            residuals[:, running].T.cpu().numpy(),
        )

    end = layer.settle(
        None if x is None else torch.as_tensor(x),
        inputs,
        settling=settling,
        limit=limit,
        check=check,
        progress=progress,
        observe=record if curves else None,
    )
    states, residuals = end.states.cpu().numpy(), end.residuals.T.cpu().numpy()
    still = Outcome.STOPPED if end.stopped else Outcome.NOT_SETTLED
    outcomes = OUTCOMES | {RUNNING: still}
    return BatchRun(
        network=network,
        inputs={
            name: np.broadcast_to(values, (len(states), network.stages))
            for name, values in input_batch(network, inputs).items()
        },
        states=states,
        outcomes=tuple(outcomes[code] for code in end.codes.tolist()),
        steps=end.steps.cpu().numpy(),
        settling_steps=end.settling_steps.cpu().numpy(),
        settling_times=end.settling_times.cpu().numpy(),
        residuals=residuals,
        curves=recorder.curves(states, residuals) if curves else None,
    )
