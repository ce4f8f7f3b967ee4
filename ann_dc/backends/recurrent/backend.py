"""Backend with recurrent steps for one network with trajectory, or for a batch.

A single run checks every step and records each, unless there are thousands. A batch checks every
fifth step only; it returns the outcome of each sample and, if requested, its trajectory. Both use
generated code, without torch. Acceleration, a GPU, and a wiring without code generation run in the
layers, which need torch.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from ann_dc.backends import status
from ann_dc.backends.batch import BatchRun
from ann_dc.backends.batched.group import Group
from ann_dc.backends.batched.recurrence import Checks, Recurrence, recur_lanes
from ann_dc.backends.batched.recurrence_code import ROWS
from ann_dc.backends.lane_batch import Thread, attempts_of, ends_of, run_lanes
from ann_dc.backends.recorder import Recorder
from ann_dc.backends.run import Run
from ann_dc.backends.settling import GROWTH, Settling
from ann_dc.backends.status import Outcome, Status
from ann_dc.backends.step_rules import (
    NAMES,
    SIMULTANEOUS,
    TWO_PHASE,
    AdaptiveStep,
    Anderson,
    FixedStep,
    Order,
    StepLimits,
    StepRule,
    check_order,
    lengths_of,
)
from ann_dc.backends.trajectory import SAMPLES
from ann_dc.conversion import OrWord, default
from ann_dc.errors import NetworkError
from ann_dc.evaluation.codegen.evaluator import fast_evaluator
from ann_dc.evaluation.codegen.lanes import Lanes
from ann_dc.evaluation.codegen.plan import refusal
from ann_dc.evaluation.reference import evaluator
from ann_dc.evaluation.variant_numbers import Numbers
from ann_dc.network.inputs import waveform_batch
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.base import ALL_KINDS, PreconditionerKind
from ann_dc.network.waveforms import check_constant
from ann_dc.progress import Progress, Stopped, silent
from ann_dc.validation import Count, Index, checked

LARGEST_CURVE = 40_000_000
"""Largest count of state values that a run records."""
LATE = 4
"""Reciprocal of the last fraction of a run in which a stalled network shows oscillation."""
SHORTER = "shorter steps: step=ann_dc.AdaptiveStep() or none"
"""Advice for steps of a fixed length, which may prevent a network from settling."""
CHECK = 5
"""Steps of a batch between two convergence checks."""
CHECK_ON_GPU = 40
"""Steps between two checks on a GPU, where every check makes the processor wait."""


@checked
@dataclass(frozen=True, kw_only=True, eq=False)
class RecurrentBackend:
    """Backend that runs networks in discrete time, in generated code or in torch.

    Acceleration, a GPU, and a wiring without code generation require the layers. Nothing else needs
    torch.

    Attributes
    ----------
    order : Order or str
        Update order, or its name such as "two-phase": `SIMULTANEOUS` (default),
        `TWO_PHASE` or `STAGE_BY_STAGE`.
    step : StepRule or None
        Step rule, as in `RecurrentLayer`.
    acceleration : Anderson or None
        Acceleration; None takes every step as the network gives it.
    settling : Settling
        Definition of a settled run.
    limit : int, default 50,000
        Largest number of steps.
    curves : int, default 0
        Number of states that `run_batch` stores of every sample, for ``batch.trajectory(sample)``;
        0 stores the last state only. States are recorded every `CHECK` steps (on a GPU every
        `CHECK_ON_GPU`) and thinned above this number. A batch of B samples of n neurons takes up to
        8 B n ``curves`` bytes: 200 states of a thousand cars are 260 MB.
    device : str
        Torch device: ``cpu`` (default) or ``cuda``.
    progress : Progress
        Receiver of one progress line every half second.

    Raises
    ------
    NetworkError
        If torch does not have the device.
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

    order: OrWord[Order] = default(SIMULTANEOUS)
    step: StepRule | None = None
    acceleration: Anderson | None = None
    settling: Settling = field(default_factory=Settling)
    limit: Count = 50_000
    curves: Index = 0
    device: str = "cpu"
    progress: Progress = silent

    def __post_init__(self) -> None:
        if not self._is_plain:
            from ann_dc.backends.layers.cell_layer import check_device  # needs torch

            check_device(self.device)

    @property
    def kinds(self) -> tuple[PreconditionerKind, ...]:
        """Preconditioner kinds among which a design for this backend chooses.

        All kinds in the two-phase order or with acceleration, otherwise neither grid nor tree.
        Modes of grid and tree have similar speeds but little damping, and the simultaneous order is
        slow on weakly damped modes. The car takes 250 steps on a grid and 180 on a pyramid.
        """
        if self.order == TWO_PHASE or self.acceleration is not None:
            return ALL_KINDS
        return tuple(
            kind
            for kind in ALL_KINDS
            if kind not in (PreconditionerKind.RESISTIVE_GRID, PreconditionerKind.CYCLIC_REDUCTION)
        )

    @property
    def _is_plain(self) -> bool:
        """True if generated code supports all settings of the run."""
        return self.acceleration is None and self.device == "cpu"

    def layer(self, network: Network):
        """Return the `RecurrentLayer` that runs a network with these settings; needs torch."""
        from ann_dc.backends.layers.recurrent_layer import RecurrentLayer  # needs torch

        return RecurrentLayer(
            network,
            order=self.order,
            step=self.step,
            acceleration=self.acceleration,
            device=self.device,
        )

    @checked
    def run(self, network: Network) -> Run:
        """Step from the start until the network settles, diverges or runs out of steps.

        Returns
        -------
        Run
            Result for every outcome; its network time is the sum of the step lengths.
        """
        why: list[str] = []

        def reported(line: str) -> None:
            try:
                self.progress(line)
            except Stopped as end:
                why.append(str(end))
                raise

        room = int(np.clip(LARGEST_CURVE // max(network.size, 1), 2, 2 * SAMPLES))
        batch = self._batch(network, {}, None, None, check=1, curves=room, progress=reported)
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
        check_constant(waveform_batch(network, inputs))
        if self._is_plain and refusal(evaluator(network).tape) is None:
            begin = self._begin(network, check)
            return run_lanes(
                network, inputs, x, begin,
                numbers=numbers, curves=curves, threads=None, progress=progress,
            )  # fmt: skip
        if numbers is not None:
            raise NetworkError(
                "numbers: only generated code supports numbers per sample; omit acceleration "
                "and device, or use smaller cells"
            )
        from ann_dc.backends.layers import batch_run  # needs torch

        return batch_run.run_batch(
            self.layer(network),
            inputs,
            x,
            settling=self.settling,
            limit=self.limit,
            check=check,
            curves=curves,
            progress=progress,
        )

    def _begin(self, network: Network, check: int) -> Callable[[Lanes], Thread]:
        """Return a function that prepares the recurrence of a thread, checked now and then."""
        lengths = lengths_of(self.step or AdaptiveStep(), StepLimits(network))
        order, ends = NAMES.index(self.order.name), ends_of(self.settling, self.limit)
        checks, attempts = Checks(order, check, GROWTH, ends), attempts_of(network)

        def begin(lanes: Lanes) -> Thread:
            group, recurrence = Group.of(lanes, 2, ROWS), Recurrence.of(lanes, lengths, checks)
            return Thread(group, lambda *given: recur_lanes(group, recurrence, *given, attempts))

        return begin

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
            Network of which all samples are copies.
        inputs : mapping of input name to number, (B,) or (B, N) array
            Inputs that replace those of ``network.inputs``. An input that is not finite fails only
            its sample.
        x : (n,) or (B, n) array, optional
            Initial guess in network units; by default the network's start, with boundary conditions
            adapted to the inputs.
        numbers : Numbers, optional
            Weights and time constants of every sample, from `numbers_of`; by default those of the
            network, which determine the step lengths in any case. Only without acceleration, on the
            CPU.

        Returns
        -------
        BatchRun
            Final states, outcomes, steps and settling times of all samples.

        Raises
        ------
        UnknownNameError, NetworkError
            If an input does not exist; if sizes do not agree or ``curves`` is not a number of
            states; if numbers belong to another wiring or are passed to layers.

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
    """Return the status of the only run of a batch, from its states (T, n)."""
    network, x, steps = batch.network, batch.states[0], int(batch.steps[0])
    constraint, stationarity = batch.residuals[0].tolist()
    outcome, residuals = batch.outcomes[0], (constraint, stationarity)
    name = status.residual_name(network)
    if outcome is Outcome.SETTLED:
        return status.settled(max(residuals), now, name)
    if outcome is Outcome.DIVERGED:
        return status.diverged(network, x, now, f"after {steps} steps")
    if outcome is Outcome.LEFT_DOMAIN:
        return _left_domain(network, x, now)
    if outcome is Outcome.STALLED:
        swings = status.swinging(network, states[-len(states) // LATE :])
        advice = status.DAMPING if swings else status.elsewhere(network)
        advice = advice if adapts else f"use {SHORTER}; else {advice}"
        why = swings or f"the last of {steps} steps did not reduce it"
        return status.stalled(residuals, now, why, advice, name)
    if outcome is Outcome.STOPPED:
        return status.stopped(residuals, now, why, name)
    return status.not_settled(residuals, now, f"{steps} steps (limit)", name)


def _left_domain(network: Network, x: np.ndarray, now: float) -> Status:
    compiled = fast_evaluator(network)
    block, stage = compiled.outside(x, compiled.domain_guard(network.start_state))
    if block >= 0:
        return status.left_domain(network, block, stage, now)
    return status.diverged(network, x, now, "a function block left its domain")
