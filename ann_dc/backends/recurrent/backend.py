"""The recurrent layers as a backend: one network with its trajectory, or a batch of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
import torch

from ann_dc.backends import status
from ann_dc.backends.batch import BatchRun
from ann_dc.backends.recorder import Recorder
from ann_dc.backends.recurrent.acceleration import Anderson
from ann_dc.backends.recurrent.layer import RecurrentLayer
from ann_dc.backends.recurrent.ledger import Settled
from ann_dc.backends.recurrent.loop import DIVERGED, LEFT_DOMAIN, SETTLED, Loop
from ann_dc.backends.recurrent.orders import SIMULTANEOUS, Order
from ann_dc.backends.recurrent.steps import StepRule
from ann_dc.backends.run import Run
from ann_dc.backends.settling import Settling
from ann_dc.backends.status import Outcome, Status
from ann_dc.evaluation.compiled import CompiledEvaluator
from ann_dc.network.inputs import input_batch
from ann_dc.network.network import Network

OUTCOMES = {
    SETTLED: Outcome.SETTLED,
    DIVERGED: Outcome.DIVERGED,
    LEFT_DOMAIN: Outcome.LEFT_DOMAIN,
}
"""Outcome of a sample; any other code means not settled."""


@dataclass(frozen=True, kw_only=True, eq=False)
class RecurrentBackend:
    """Runs networks in discrete time, on torch.

    Attributes
    ----------
    order : Order
    step : StepRule or None
        As in `RecurrentLayer`.
    acceleration : Anderson or None
    settling : Settling
    limit : int
        Largest number of steps.
    device : str
    progress : callable or None
        Told one line every half second.

    Examples
    --------
    >>> from ann_dc import plants, solve
    >>> solution = solve(plants.double_integrator(N=5), backend=RecurrentBackend())
    >>> solution.certified
    True
    """

    order: Order = SIMULTANEOUS
    step: StepRule | None = None
    acceleration: Anderson | None = None
    settling: Settling = field(default_factory=Settling)
    limit: int = 50_000
    device: str = "cpu"
    progress: Callable[[str], None] | None = None

    def layer(self, network: Network) -> RecurrentLayer:
        """The recurrent layer that runs a network."""
        return RecurrentLayer(
            network,
            order=self.order,
            step=self.step,
            acceleration=self.acceleration,
            device=self.device,
        )

    def run(self, network: Network) -> Run:
        """Step from the network's start until it settles, diverges, or the steps are up."""
        layer, start = self.layer(network), network.start_state
        record: list[Recorder] = []
        now = 0.0

        def observe(loop: Loop, residuals: torch.Tensor) -> None:
            nonlocal now
            now = float(loop.time[0])
            x = layer.cell.pack(loop.state)[0].cpu().numpy()
            both = (float(residuals[0, 0]), float(residuals[1, 0]))
            if record:
                record[0].step(now, x, both)
            else:
                record.append(Recorder(network, x, both))

        end = layer.settle(
            settling=self.settling, limit=self.limit, progress=self.progress, observe=observe
        )
        x = end.states[0].cpu().numpy()
        ended = self._status(network, start, x, end, now)
        return record[0].run(now, x, ended, self.settling, int(end.steps[0]))

    def _status(self, network: Network, start, x: np.ndarray, end: Settled, now: float) -> Status:
        code = int(end.codes[0])
        residuals = (float(end.residuals[0, 0]), float(end.residuals[1, 0]))
        if code == SETTLED:
            return status.settled(max(residuals), now)
        if code == DIVERGED:
            return status.diverged(network, x, now, f"after {int(end.steps[0])} steps")
        if code == LEFT_DOMAIN:
            kernel = CompiledEvaluator(network)
            block, stage = kernel.outside(x, kernel.domain_guard(start))
            if block >= 0:
                return status.left_domain(network, block, stage, now)
            return status.diverged(network, x, now, "a function block left its domain")
        why = f"{int(end.steps[0])} steps were done (limit)"
        return status.not_settled(residuals, now, why)

    def run_batch(
        self, network: Network, inputs: Mapping[str, object], x: np.ndarray | None = None
    ) -> BatchRun:
        """Run one copy of a network for each sample of its inputs.

        Parameters
        ----------
        network : Network
        inputs : mapping of input name to number, (B,) or (B, N) array
            What is not given is the network's own. An input that is no finite number costs its
            own sample only.
        x : (n,) or (B, n) array, optional
            Where to start; by default the network's start, its ends moved with the inputs.

        Raises
        ------
        UnknownNameError, NetworkError
            If an input does not exist, or sizes do not agree.
        """
        end = self.layer(network).settle(
            None if x is None else torch.as_tensor(x),
            inputs,
            settling=self.settling,
            limit=self.limit,
            check=CHECK,
            progress=self.progress,
        )
        return BatchRun(
            network=network,
            inputs={
                name: np.broadcast_to(values, (len(end.states), network.stages))
                for name, values in input_batch(network, inputs).items()
            },
            states=end.states.cpu().numpy(),
            outcomes=tuple(OUTCOMES.get(code, Outcome.NOT_SETTLED) for code in end.codes.tolist()),
            steps=end.steps.cpu().numpy(),
            settling_steps=end.settling_steps.cpu().numpy(),
            residuals=end.residuals.T.cpu().numpy(),
        )


CHECK = 5
"""Steps of a batch between two looks at who has settled."""
