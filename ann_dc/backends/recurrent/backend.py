"""The recurrent layers as a backend: one network with its trajectory, or a batch of them.

A run looks at every step, and takes down each unless there are thousands; a batch looks at every
fifth only, and says of each sample how it ended, and where it was on its way if it is asked to.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TypeAlias

import numpy as np
import torch

from ann_dc.backends import status
from ann_dc.backends.batch import BatchRun
from ann_dc.backends.batch_recorder import BatchCurves, BatchRecorder
from ann_dc.backends.recorder import SAMPLES, Recorder
from ann_dc.backends.recurrent import in_code
from ann_dc.backends.recurrent.acceleration import Anderson
from ann_dc.backends.recurrent.cell.layer import check_device
from ann_dc.backends.recurrent.layer import RecurrentLayer
from ann_dc.backends.recurrent.ledger import (
    DIVERGED,
    LEFT_DOMAIN,
    SETTLED,
    STALLED,
    Ledger,
    Settled,
)
from ann_dc.backends.recurrent.loop import Loop
from ann_dc.backends.recurrent.orders import SIMULTANEOUS, TWO_PHASE, Order
from ann_dc.backends.recurrent.steps import AdaptiveStep, StepRule
from ann_dc.backends.run import Run
from ann_dc.backends.settling import Settling
from ann_dc.backends.status import Outcome, Status
from ann_dc.errors import NetworkError
from ann_dc.evaluation.generated.choice import fast_evaluator
from ann_dc.hints.checked import checked
from ann_dc.hints.values import Count, Index
from ann_dc.network.inputs import input_batch
from ann_dc.network.metrics.contract import ALL_KINDS, Kind
from ann_dc.network.network import Network
from ann_dc.progress import Progress, Stopped, silent

OUTCOMES = {
    SETTLED: Outcome.SETTLED,
    DIVERGED: Outcome.DIVERGED,
    LEFT_DOMAIN: Outcome.LEFT_DOMAIN,
    STALLED: Outcome.STALLED,
}
"""Outcome of a sample; any other code means that the run was over first."""
_End: TypeAlias = tuple[Outcome, np.ndarray, tuple[float, float], int, str]
"""How a run ended, its last state, residuals and steps, and why somebody ended it."""
LARGEST_CURVE = 40_000_000
"""Numbers of all states that a run in generated code takes down."""
CHECK = 5
"""Steps of a batch between two looks at who has settled."""
CHECK_ON_GPU = 40
"""The same where every look makes the processor wait for the GPU."""


@checked
@dataclass(frozen=True, kw_only=True, eq=False)
class RecurrentBackend:
    """Runs networks in discrete time: in generated code, or in the layers on torch.

    Acceleration, a GPU and rules of steps of one's own are for the layers.

    Attributes
    ----------
    order : Order
        `SIMULTANEOUS`, `TWO_PHASE` or `STAGE_BY_STAGE`.
    step : StepRule or None
        As in `RecurrentLayer`.
    acceleration : Anderson or None
        None: every step is the network's own.
    settling : Settling
        When a run counts as settled.
    limit : int
        Largest number of steps.
    curves : int
        States that `run_batch` keeps of every sample on its way, seen every `CHECK` steps (on a GPU
        every `CHECK_ON_GPU`) and thinned beyond that number, so that ``batch.trajectory(sample)``
        is there; 0: the last one alone. A batch of B samples of n neurons takes up to 8 B n
        ``curves`` bytes: 200 states of a thousand cars are 260 MB.
    device : str
        Of torch: ``cpu``, ``cuda``.
    progress : Progress
        Told one line every half second.

    Raises
    ------
    NetworkError
        If torch has no such device.

    Examples
    --------
    >>> from ann_dc import plants, solve
    >>> solution = solve(plants.double_integrator(N=5), backend=RecurrentBackend())
    >>> solution.certified
    True

    References
    ----------
    Paper equations (16), (17), corrected.
    """

    order: Order = SIMULTANEOUS
    step: StepRule | None = None
    acceleration: Anderson | None = None
    settling: Settling = field(default_factory=Settling)
    limit: Count = 50_000
    curves: Index = 0
    device: str = "cpu"
    progress: Progress = silent

    def __post_init__(self) -> None:
        check_device(self.device)

    @property
    def kinds(self) -> tuple[Kind, ...]:
        """All metrics in the two-phase order or with acceleration, else no grid and no tree.

        Their modes are alike in speed but little damped, and the simultaneous order is slow on
        what is little damped: the car takes 250 steps on a grid, 180 on a pyramid.
        """
        if self.order is TWO_PHASE or self.acceleration is not None:
            return ALL_KINDS
        return tuple(kind for kind in ALL_KINDS if kind not in (Kind.GRID, Kind.TREE))

    @checked
    def layer(self, network: Network) -> RecurrentLayer:
        """The recurrent layer that runs a network."""
        return RecurrentLayer(
            network,
            order=self.order,
            step=self.step,
            acceleration=self.acceleration,
            device=self.device,
        )

    @checked
    def run(self, network: Network) -> Run:
        """Step from the network's start until it settles, diverges, or the steps are up.

        Returns
        -------
        Run
            Its network time is the sum of the steps' lengths.
        """
        recorder = Recorder(network)
        end = self._run_in_code if self._is_in_code(network) else self._run_layer
        outcome, x, both, steps, why = end(network, recorder)
        now = recorder.residual_times[-1]
        ended = _status(network, x, outcome, both, now, steps=steps, why=why)
        return replace(recorder.run(now, x, ended, self.settling, steps), steps=steps)

    def _run_layer(self, network: Network, recorder: Recorder) -> _End:
        layer = self.layer(network)

        def observe(loop: Loop, residuals: torch.Tensor, _: Ledger) -> None:
            x = layer.cell.pack(loop.state)[0].cpu().numpy()
            both = float(residuals[0, 0]), float(residuals[1, 0])
            recorder.record(float(loop.time[0]), x, both)

        end = layer.settle(
            settling=self.settling, limit=self.limit, progress=self.progress, observe=observe
        )
        still = Outcome.STOPPED if end.stopped else Outcome.NOT_SETTLED
        outcome = OUTCOMES.get(int(end.codes[0]), still)
        x, steps = end.states[0].cpu().numpy(), int(end.steps[0])
        both = float(end.residuals[0, 0]), float(end.residuals[1, 0])
        return outcome, x, both, steps, end.stopped

    def _run_in_code(self, network: Network, recorder: Recorder) -> _End:
        """A batch of one, looked at every step; a very long run is taken down more rarely."""
        why: list[str] = []

        def told(line: str) -> None:
            try:
                self.progress(line)
            except Stopped as end:
                why.append(str(end))
                raise

        room = int(np.clip(LARGEST_CURVE // max(network.size, 1), 2, 2 * SAMPLES))
        batch = self._batch_in_code(network, {}, None, check=1, curves=room, progress=told)
        curve, both = batch.trajectory(0), batch.residuals[0]
        taken = curve.time, curve.states
        recorder.record_all(curve.residual_time, curve.residuals, taken)
        steps, (constraint, stationarity) = int(batch.steps[0]), both.tolist()
        return batch.outcomes[0], batch.states[0], (constraint, stationarity), steps, "".join(why)

    def _is_in_code(self, network: Network) -> bool:
        """Whether this is no matter for tensors."""
        plain = self.acceleration is None and self.device == "cpu"
        return plain and in_code.is_possible(network, self.order, self.step or AdaptiveStep())

    def _batch_in_code(
        self,
        network: Network,
        inputs: Mapping[str, object],
        x: np.ndarray | None,
        *,
        check: int,
        curves: int,
        progress: Progress,
    ) -> BatchRun:
        return in_code.run_batch(
            network,
            inputs,
            x,
            in_code.looks_of(self.order, self.settling, self.limit, check),
            self.step or AdaptiveStep(),
            curves=curves,
            progress=progress,
        )

    @checked
    def run_batch(
        self, network: Network, inputs: Mapping[str, object], x: np.ndarray | None = None
    ) -> BatchRun:
        """Run one copy of a network for each sample of its inputs.

        Parameters
        ----------
        network : Network
            What all samples are copies of.
        inputs : mapping of input name to number, (B,) or (B, N) array
            As in ``network.inputs``, from which the rest is taken. An input that is no finite
            number costs its own sample only.
        x : (n,) or (B, n) array, optional
            Where to start, in network units; by default the network's start, its ends moved with
            the inputs.

        Returns
        -------
        BatchRun

        Raises
        ------
        UnknownNameError, NetworkError
            If an input does not exist, sizes do not agree, or ``curves`` is no number of states.

        Examples
        --------
        >>> import ann_dc
        >>> network = ann_dc.design(ann_dc.plants.double_integrator(N=3)).network
        >>> backend = ann_dc.RecurrentBackend(acceleration=ann_dc.Anderson())
        >>> batch = backend.run_batch(network, {"q_d.x": [0.5, 1.0, 2.0]})
        >>> batch.states.shape == (3, network.size), batch.settled.all()
        (True, np.True_)
        """
        if self._is_in_code(network):
            curves = max(self.curves, 2) if self.curves else 0
            return self._batch_in_code(
                network, inputs, x, check=CHECK, curves=curves, progress=self.progress
            )
        keeper = _Keeper(self.curves)
        end = self.layer(network).settle(
            None if x is None else torch.as_tensor(x),
            inputs,
            settling=self.settling,
            limit=self.limit,
            check=CHECK if self.device == "cpu" else CHECK_ON_GPU,
            progress=self.progress,
            observe=keeper if self.curves else None,
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
    """Takes a batch down while it is settled; nothing of it where it is not asked."""

    def __init__(self, most: int) -> None:
        if not isinstance(most, int) or isinstance(most, bool) or most < 0:
            raise NetworkError(
                f"curves: expected a whole number of states to keep, from zero on, got {most!r}"
            )
        self.most = most
        self.recorder: BatchRecorder | None = None

    def __call__(self, loop: Loop, residuals: torch.Tensor, ledger: Ledger) -> None:
        if self.recorder is None:
            self.recorder = BatchRecorder(len(ledger.codes), max(self.most, 2))
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


def _status(
    network: Network,
    x: np.ndarray,
    outcome: Outcome,
    residuals: tuple[float, float],
    now: float,
    *,
    steps: int,
    why: str,
) -> Status:
    """How a run ended, in a sentence."""
    if outcome is Outcome.SETTLED:
        return status.settled(max(residuals), now)
    if outcome is Outcome.DIVERGED:
        return status.diverged(network, x, now, f"after {steps} steps")
    if outcome is Outcome.LEFT_DOMAIN:
        return _left_domain(network, x, now)
    if outcome is Outcome.STALLED:
        return status.stalled(residuals, now, f"{steps} steps made it no smaller in the end")
    if outcome is Outcome.STOPPED:
        return status.stopped(residuals, now, why)
    return status.not_settled(residuals, now, f"{steps} steps were done (limit)")


def _left_domain(network: Network, x: np.ndarray, now: float) -> Status:
    evaluator = fast_evaluator(network)
    block, stage = evaluator.outside(x, evaluator.domain_guard(network.start_state))
    if block >= 0:
        return status.left_domain(network, block, stage, now)
    return status.diverged(network, x, now, "a function block left its domain")
