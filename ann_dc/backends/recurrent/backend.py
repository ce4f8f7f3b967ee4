"""Recurrent steps as a backend: one network with its trajectory, or a batch of them.

A run looks at every step, and takes down each unless there are thousands; a batch looks at every
fifth only, and says of each sample how it ended, and where it was on its way if it is asked to.
Both are in generated code; what that does not know is for the layers, which need torch.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from ann_dc.backends import status
from ann_dc.backends.batch import BatchRun
from ann_dc.backends.recorder import Recorder
from ann_dc.backends.recurrent import in_code
from ann_dc.backends.recurrent.rules.acceleration import Anderson
from ann_dc.backends.recurrent.rules.orders import SIMULTANEOUS, TWO_PHASE, Order, check_order
from ann_dc.backends.recurrent.rules.steps import AdaptiveStep, FixedStep, StepRule
from ann_dc.backends.run import Run
from ann_dc.backends.settling import Settling
from ann_dc.backends.status import Outcome, Status
from ann_dc.backends.trajectory import SAMPLES
from ann_dc.errors import NetworkError
from ann_dc.evaluation.codegen.evaluator import fast_evaluator
from ann_dc.evaluation.variant_numbers import Numbers
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.base import ALL_KINDS, Kind
from ann_dc.progress import Progress, Stopped, silent
from ann_dc.validation.checked import checked
from ann_dc.validation.values import Count, Index

LARGEST_CURVE = 40_000_000
"""Numbers of all states that a run takes down."""
LATE = 4
"""Part of the states of a run, its last, in which a stalled network shows that it swings."""
SHORTER = "shorter steps: step=ann_dc.AdaptiveStep() or none"
"""Advice for steps of a fixed length, which may be what keeps a network from settling."""
CHECK = 5
"""Steps of a batch between two looks at who has settled."""
CHECK_ON_GPU = 40
"""The same where every look makes the processor wait for the GPU."""


@checked
@dataclass(frozen=True, kw_only=True, eq=False)
class RecurrentBackend:
    """Runs networks in discrete time: in generated code, or in layers on torch.

    Acceleration and a GPU are for the layers, and so is a wiring that no code is generated for;
    nothing else needs torch.

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
    ImportError
        If layers are needed and torch is not installed.

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
        if not self._is_plain:
            from ann_dc.backends.recurrent.cell.layer import check_device  # needs torch

            check_device(self.device)

    @property
    def kinds(self) -> tuple[Kind, ...]:
        """All metrics in the two-phase order or with acceleration, else no grid and no tree.

        Their modes are alike in speed but little damped, and the simultaneous order is slow on
        what is little damped: the car takes 250 steps on a grid, 180 on a pyramid.
        """
        if self.order == TWO_PHASE or self.acceleration is not None:
            return ALL_KINDS
        return tuple(kind for kind in ALL_KINDS if kind not in (Kind.GRID, Kind.TREE))

    @property
    def _is_plain(self) -> bool:
        """Whether generated code knows all that a run is told."""
        return self.acceleration is None and self.device == "cpu"

    def layer(self, network: Network):
        """The `RecurrentLayer` that runs a network; needs torch.

        Parameters
        ----------
        network : Network

        Returns
        -------
        RecurrentLayer
        """
        from ann_dc.backends.recurrent.layers.layer import RecurrentLayer  # needs torch

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
        why: list[str] = []

        def told(line: str) -> None:
            try:
                self.progress(line)
            except Stopped as end:
                why.append(str(end))
                raise

        room = int(np.clip(LARGEST_CURVE // max(network.size, 1), 2, 2 * SAMPLES))
        batch = self._batch(network, {}, None, None, check=1, curves=room, progress=told)
        curve, recorder = batch.trajectory(0), Recorder(network)
        recorder.record_all(curve.residual_time, curve.residuals, curve.states)
        now, steps = recorder.residual_times[-1], int(batch.steps[0])
        ended = _status(
            batch, now, "".join(why), curve.states, adapts=not isinstance(self.step, FixedStep)
        )
        run = recorder.run(now, batch.states[0], ended, self.settling, steps)
        return replace(run, steps=steps)

    def _batch(
        self,
        network: Network,
        inputs: Mapping[str, object],
        x: np.ndarray | None,
        numbers: Numbers | None,
        *,
        check: int,
        curves: int,
        progress: Progress,
    ) -> BatchRun:
        check_order(self.order, network)
        if self._is_plain and in_code.is_possible(network):
            looks = in_code.looks_of(self.order, self.settling, self.limit, check)
            step = self.step or AdaptiveStep()
            return in_code.run_batch(
                network, inputs, x, looks, step,
                numbers=numbers, curves=curves, progress=progress,
            )  # fmt: skip
        if numbers is not None:
            raise NetworkError(
                "numbers: only generated code takes those of every sample; leave out acceleration "
                "and device, and connections beyond neighbours"
            )
        from ann_dc.backends.recurrent.layers import in_layers  # needs torch

        return in_layers.run_batch(
            self.layer(network),
            inputs,
            x,
            settling=self.settling,
            limit=self.limit,
            check=check,
            curves=curves,
            progress=progress,
        )

    @checked
    def run_batch(
        self,
        network: Network,
        inputs: Mapping[str, object],
        x: np.ndarray | None = None,
        numbers: Numbers | None = None,
    ) -> BatchRun:
        """Run one copy of a network for each sample of its inputs or numbers.

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
        numbers : Numbers, optional
            Weights and time constants of every sample, from `numbers_of`; by default the network's,
            by which the lengths of steps go in any case. Only without acceleration, on the CPU.

        Returns
        -------
        BatchRun

        Raises
        ------
        UnknownNameError, NetworkError
            If an input does not exist, sizes do not agree, ``curves`` is no number of states, or
            numbers are those of another wiring or given to layers.

        Examples
        --------
        >>> import ann_dc
        >>> network = ann_dc.design(ann_dc.plants.double_integrator(N=3)).network
        >>> backend = ann_dc.RecurrentBackend(acceleration=ann_dc.Anderson())
        >>> batch = backend.run_batch(network, {"q_d.x": [0.5, 1.0, 2.0]})
        >>> batch.states.shape == (3, network.size), batch.settled.all()
        (True, np.True_)
        """
        check = CHECK if self.device == "cpu" else CHECK_ON_GPU
        curves = max(self.curves, 2) if self.curves else 0
        return self._batch(
            network, inputs, x, numbers, check=check, curves=curves, progress=self.progress
        )


def _status(batch: BatchRun, now: float, why: str, states: np.ndarray, *, adapts: bool) -> Status:
    """How the only run of a batch ended at a network time, from its states (T, n) on the way."""
    network, x, steps = batch.network, batch.states[0], int(batch.steps[0])
    constraint, stationarity = batch.residuals[0].tolist()
    outcome, residuals = batch.outcomes[0], (constraint, stationarity)
    if outcome is Outcome.SETTLED:
        return status.settled(max(residuals), now)
    if outcome is Outcome.DIVERGED:
        return status.diverged(network, x, now, f"after {steps} steps")
    if outcome is Outcome.LEFT_DOMAIN:
        return _left_domain(network, x, now)
    if outcome is Outcome.STALLED:
        swings = status.swinging(network, states[-len(states) // LATE :])
        advice = status.DAMPING if swings else status.elsewhere(network)
        advice = advice if adapts else f"take {SHORTER}; else {advice}"
        why = swings or f"{steps} steps made it no smaller in the end"
        return status.stalled(residuals, now, why, advice)
    if outcome is Outcome.STOPPED:
        return status.stopped(residuals, now, why)
    return status.not_settled(residuals, now, f"{steps} steps were done (limit)")


def _left_domain(network: Network, x: np.ndarray, now: float) -> Status:
    evaluator = fast_evaluator(network)
    block, stage = evaluator.outside(x, evaluator.domain_guard(network.start_state))
    if block >= 0:
        return status.left_domain(network, block, stage, now)
    return status.diverged(network, x, now, "a function block left its domain")
