"""Recurrent runs in layers: with acceleration, on a GPU, and for any wiring.

One or many runs are supported.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import torch

from ann_dc.backends.batch import BatchRun
from ann_dc.backends.batch_recorder import BatchCurves, BatchRecorder
from ann_dc.backends.recurrent.layers.layer import RecurrentLayer
from ann_dc.backends.recurrent.layers.ledger import (
    DIVERGED,
    LEFT_DOMAIN,
    SETTLED,
    STALLED,
    Ledger,
    Settled,
)
from ann_dc.backends.recurrent.layers.loop import Loop
from ann_dc.backends.settling import Settling
from ann_dc.backends.status import Outcome
from ann_dc.network.inputs import input_batch
from ann_dc.progress import Progress

OUTCOMES = {
    SETTLED: Outcome.SETTLED,
    DIVERGED: Outcome.DIVERGED,
    LEFT_DOMAIN: Outcome.LEFT_DOMAIN,
    STALLED: Outcome.STALLED,
}
"""Outcome of a sample by code; any other code means that the run ended before."""


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
    network, keeper = layer.cell.network, _Keeper(curves)
    end = layer.settle(
        None if x is None else torch.as_tensor(x),
        inputs,
        settling=settling,
        limit=limit,
        check=check,
        progress=progress,
        observe=keeper if curves else None,
    )
    still = Outcome.STOPPED if end.stopped else Outcome.NOT_SETTLED
    return BatchRun(
        network=network,
        inputs={
            name: np.broadcast_to(values, (len(end.states), network.stages))
            for name, values in input_batch(network, inputs).items()
        },
        states=end.states.cpu().numpy(),
        outcomes=tuple(OUTCOMES.get(code, still) for code in end.codes.tolist()),
        steps=end.steps.cpu().numpy(),
        settling_steps=end.settling_steps.cpu().numpy(),
        settling_times=end.settling_times.cpu().numpy(),
        residuals=end.residuals.T.cpu().numpy(),
        curves=keeper.curves(end),
    )


class _Keeper:
    """Recorder of a batch while it settles; records nothing unless requested."""

    def __init__(self, most: int) -> None:
        self.most = most
        self.recorder: BatchRecorder | None = None

    def __call__(self, loop: Loop, residuals: torch.Tensor, ledger: Ledger) -> None:
        if self.recorder is None:
            self.recorder = BatchRecorder(len(ledger.codes), self.most)
        running = ledger.open
        self.recorder.record(
            ledger.samples[running].cpu().numpy(),
            loop.time[running].cpu().numpy(),
            loop.cell.pack(loop.state[..., running]).cpu().numpy(),
            residuals[:, running].T.cpu().numpy(),
        )

    def curves(self, end: Settled) -> BatchCurves | None:
        if self.recorder is None:
            return None
        return self.recorder.curves(end.states.cpu().numpy(), end.residuals.T.cpu().numpy())
