"""Network in continuous time: a compiled integrator or one of SciPy's solvers.

A run ends when the network settles, not at a guessed horizon. The residual must fall below the
tolerance and then continue to a small fraction of it, so that a hovering residual does not count as
settled. The settling time is the last exit, never the first crossing.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from ann_dc.backends import status
from ann_dc.backends.batch import BatchRun
from ann_dc.backends.batched.continuous import Integration, advance_lanes
from ann_dc.backends.batched.continuous_code import ROWS
from ann_dc.backends.batched.group import Group
from ann_dc.backends.batched.located import Again, locate_exits
from ann_dc.backends.batched.segments import Driven, lines_of
from ann_dc.backends.integration.drawing import CompiledAgain
from ann_dc.backends.integration.driven import DrivenAgain, DrivenStepper
from ann_dc.backends.integration.integrator import Ends
from ann_dc.backends.integration.methods import (
    BATCHES as BATCHES,
    BDF as BDF,
    COMPILED as COMPILED,
    DOP853 as DOP853,
    LSODA as LSODA,
    METHODS as METHODS,
    RADAU as RADAU,
    RK23 as RK23,
    RK45 as RK45,
    Method as Method,
)
from ann_dc.backends.integration.steppers import (
    FIRST_STEP,
    Beginning,
    RightHandSide,
    Stepper,
    fastest_rate,
    stepper_of,
)
from ann_dc.backends.integration.systems import Cells
from ann_dc.backends.lane_batch import Thread, attempts_of, ends_of, run_lanes
from ann_dc.backends.recorder import Recorder
from ann_dc.backends.run import Run
from ann_dc.backends.settling import HEADWAY, Settling, window_of
from ann_dc.backends.status import OVERFLOW, Outcome, Status
from ann_dc.conversion import OrWord, default
from ann_dc.errors import NetworkError
from ann_dc.evaluation.codegen.evaluator import fast_evaluator
from ann_dc.evaluation.codegen.lanes import Lanes
from ann_dc.evaluation.drive import Drive
from ann_dc.evaluation.interpreted import InterpretedEvaluator
from ann_dc.evaluation.variant_numbers import Numbers
from ann_dc.network.inputs import waveform_batch
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.base import ALL_KINDS, PreconditionerKind
from ann_dc.network.waveforms import Waveform
from ann_dc.progress import Paced, Progress, Stopped, silent
from ann_dc.validation import Count, Index, Positive, PositiveFinite, checked

LIMIT = 20_000.0
"""Longest run by default, in fastest time constants of a network."""
ENDLESS = 2**53
"""Number of steps that no run takes."""

CRAWL = 1000
"""Number of steps that together must cover at least one fastest time constant (of the start)."""


@checked
@dataclass(frozen=True, kw_only=True, eq=False)
class OdeBackend:
    """Backend that integrates dx/ds = M d(x) in continuous time.

    Attributes
    ----------
    method : Method or str
        Integration method, or its name ("RK45"). The default `COMPILED` is the Dormand-Prince pair
        of order eight in compiled code. SciPy's explicit `DOP853` and `RK45` are alternatives; the
        implicit `RADAU`, `BDF` and `LSODA` suit stiff networks.
    cells : Cells
        Evaluation of the cells by a compiled method: interpreted or in generated code. Both agree
        to rounding. By default code is generated if the wiring allows it.
    settling : Settling
        Definition of a settled run.
    duration : float or None, default None
        Network time of every run. A run of a given duration ends exactly then, whether or not the
        network settles, so that oscillators and chaos can run as well; ``limit`` and ``most_steps``
        have no effect. With None, a run ends when the network settles.
    limit : float or None, default None
        Longest run, in fastest time constants of the network at its start; the run ends exactly
        then. With None the limit is 20,000 of them, counted at the end of a run if the network has
        become slower.
    most_steps : int, default 50,000
        Largest number of integration steps.
    verify : bool, default True
        True to repeat a settled run at 100 times tighter tolerances and compare the settling times.
    curves : int, default 0
        Number of states that `run_batch` stores for each of B samples, in 8 B n ``curves`` bytes; 0
        stores the last state only.
    threads : int or None, default None
        Number of threads of `run_batch`; None uses one per core.
    progress : Progress
        Receiver of one progress line every half second.

    Examples
    --------
    >>> import ann_dc
    >>> problem = ann_dc.plants.double_integrator(N=5)
    >>> network = ann_dc.design(problem, preconditioner=ann_dc.PreconditionerKind.DIAGONAL).network
    >>> run = ann_dc.OdeBackend(method=ann_dc.ode.DOP853, verify=False).run(network)
    >>> run.status.settled
    True
    >>> 0 < run.settling_time < run.status.time  # it went on, to be sure of the last exit
    True

    A run of a given duration has no condition but time:

    >>> run = ann_dc.OdeBackend(duration=30.0).run(network)
    >>> run.status.time, run.status.outcome.name
    (30.0, 'COMPLETED')
    """

    method: OrWord[Method] = default(COMPILED)
    cells: Cells = Cells.WHERE_POSSIBLE
    settling: Settling = field(default_factory=Settling)
    duration: PositiveFinite | None = None
    limit: Positive | None = None
    most_steps: Count = 50_000
    verify: bool = True
    curves: Index = 0
    threads: Count | None = None
    progress: Progress = silent

    @property
    def kinds(self) -> tuple[PreconditionerKind, ...]:
        """Set of all preconditioner kinds, since the equations can be integrated with any."""
        return ALL_KINDS

    @checked
    def run(self, network: Network) -> Run:
        """Integrate from the start until the network settles, diverges or time is up.

        With a ``duration``, the run lasts exactly that long, unless the network diverges.

        Returns
        -------
        Run
            Result for every outcome; check ``status``. A failing method counts as diverged. A run
            without progress, or with very short steps, counts as stalled.
        """
        return self.follow(network)

    @checked
    def run_batch(
        self,
        network: Network,
        inputs: Mapping[str, object],
        x: np.ndarray | None = None,
        numbers: Numbers | None = None,
    ) -> BatchRun:
        """Run one copy of a network for each sample of its inputs or numbers.

        The samples run in generated code on all cores, with the method `BATCHES` unless another
        tableau is chosen. The result of a sample is bit-identical for any other samples in the
        batch and any number of threads.

        Parameters
        ----------
        network : Network
            Network of which all samples are copies.
        inputs : mapping of input name to number, (B,) or (B, N) array, or Waveform
            Inputs that replace those of ``network.inputs``. An input that is not finite fails only
            its sample. The values of a waveform are (K,), the same for all samples, (K, B) or
            (K, B, N). Waveforms of the network itself are the same for all samples. Inputs over
            time need a ``duration`` of the backend; no step passes a time of a waveform.
        x : (n,) or (B, n) array, optional
            Initial guess in network units; by default the network's start, adapted to its boundary
            conditions.
        numbers : Numbers, optional
            Weights and time constants of every sample, from `numbers_of`; by default those of the
            network. The first step and the longest time are always those of ``network``.

        Returns
        -------
        BatchRun
            Final states, outcomes, steps and settling times of all samples.

        Raises
        ------
        UnknownNameError, NetworkError
            If an input does not exist; if sizes do not agree or numbers belong to another wiring;
            if the method is not compiled or no code is generated for the wiring; if inputs change
            over time and the backend has no ``duration``.

        Examples
        --------
        >>> import ann_dc
        >>> network = ann_dc.design(ann_dc.plants.double_integrator(N=3)).network
        >>> batch = ann_dc.OdeBackend().run_batch(network, {"q_d.x": [0.5, float("nan"), 2.0]})
        >>> batch.settled.tolist(), bool(batch.settling_times[0] > 0)
        ([True, False, True], True)

        Two targets that move:

        >>> ramps = ann_dc.Waveform(times=[0.0, 90.0], values=[[1.0, 1.0], [1.5, 2.0]])
        >>> batch = ann_dc.OdeBackend(duration=100.0).run_batch(network, {"q_d.x": ramps})
        >>> [float(batch.network_of(sample).waveforms["q_d.x"].at(90.0)[0]) for sample in (0, 1)]
        [1.5, 2.0]
        """
        method = BATCHES if self.method is COMPILED else self.method
        if method.rows is None:
            raise NetworkError(
                f"method: batches run in compiled code, and {method.name} belongs to SciPy; omit it"
            )
        waveforms = waveform_batch(network, inputs)
        self._check_duration(network, waveforms)
        rows, ends = method.rows, ends_of(self.settling, self.most_steps)
        fastest = Beginning.of(network, fast_evaluator(network)).fastest
        if self.duration is not None:
            ends = ends._replace(settled=0.0, most_steps=ENDLESS, window=ENDLESS)
        steps = {
            "until": self._until(network, fastest),
            "confirmed": self.settling.confirmed,
            "first": FIRST_STEP * fastest,
            "rtol": method.rtol,
            "atol": method.atol,
        }
        attempts = attempts_of(network)
        lines = lines_of(network, waveforms, steps["until"])

        def begin(lanes: Lanes) -> Thread:
            group = Group.of(lanes, rows.slopes, ROWS)
            driven = Driven.of(lanes, network, waveforms, lines)
            integration = Integration.of(group, rows, ends, steps, driven)
            again = Again.of(group, rows, driven)
            return Thread(
                group,
                lambda *given: advance_lanes(group, integration, *given, attempts),
                lambda *given: locate_exits(group, again, *given, ends.tolerance),
            )

        settings = {n: getattr(self, n) for n in ("curves", "threads", "progress")}
        first = {n: v.at(0.0) if isinstance(v, Waveform) else v for n, v in inputs.items()}
        batch = run_lanes(network, first, x, begin, numbers=numbers, **settings)
        batch = replace(batch, waveforms=waveforms)
        if self.duration is not None:
            batch = batch.completed()
        again = DrivenAgain if waveforms else CompiledAgain
        return batch.with_between(partial(again, method=method))

    def _check_duration(self, network: Network, waveforms: Mapping[str, Waveform]) -> None:
        """Raise `NetworkError` if inputs change over time and no duration is given."""
        if waveforms and self.duration is None:
            raise NetworkError(
                f"duration: {network.title} has inputs over time ({', '.join(waveforms)}); set "
                "the duration of the run"
            )

    def _until(self, network: Network, fastest: float) -> float:
        """Return the time limit of a run, with the fastest time constant at the start."""
        if self.duration is not None:
            return self.duration
        if self.limit is not None:
            return self.limit / fastest_rate(fast_evaluator(network), network.start_state)
        return LIMIT * fastest

    @checked
    def follow(self, network: Network, rhs: RightHandSide | None = None) -> Run:
        """Integrate another right-hand side, as `run` does for the network.

        The method is for studies of systems that are not networks.

        Parameters
        ----------
        network : Network
            Network that defines the start, the residual and the domains of function blocks.
        rhs : RightHandSide, optional
            Right-hand side; by default that of the network, which alone has a Jacobian.

        Returns
        -------
        Run
            Result of the run. ``verified`` contains the outcome of the run at tighter tolerances.

        Raises
        ------
        NetworkError
            If inputs change over time and no ``duration`` is given, or another right-hand side is.
        """
        if network.waveforms and rhs is not None:
            raise NetworkError(
                "rhs: another right-hand side does not support inputs over time; omit it"
            )
        self._check_duration(network, network.waveforms)
        run = _Integration(network, self, self.method, rhs).run()
        if run.status.outcome is Outcome.COMPLETED:
            return replace(run, verified="its residual is not below the tolerance at the end")
        if not run.status.settled or not self.verify:
            return run
        tight = _Integration(network, self, self.method.tighter(), rhs).run()
        if tight.status.outcome is Outcome.STOPPED:
            why = f"{run.verified}; {tight.status}, not verified by a second run"
            return replace(run, verified=why)
        change = abs(tight.settling_time - run.settling_time) / max(run.settling_time, 1e-300)
        verdict = "agrees" if tight.status.settled and change < 0.02 else "does NOT agree"
        return replace(
            run,
            verified=(
                f"{run.verified}; a run at 100 times tighter tolerances {verdict} "
                f"({tight.settling_time:.5g} against {run.settling_time:.5g})"
            ),
        )


class _Integration:
    """One integration, executed in pieces."""

    def __init__(
        self,
        network: Network,
        backend: OdeBackend,
        method: Method,
        rhs: RightHandSide | None,
    ) -> None:
        self.network, self.backend, self.method = network, backend, method
        drive = Drive(InterpretedEvaluator(network)) if network.waveforms else None
        self.compiled = drive.evaluator if drive else fast_evaluator(network)
        self.rhs = rhs or self.compiled.rhs
        start, self.guard, residuals, self.fastest = Beginning.of(network, self.compiled)
        self.largest = OVERFLOW * max(float(np.abs(start).max(initial=0.0)), 1.0)
        self.recorder = Recorder(network)
        self.recorder.record(0.0, start, residuals)
        if drive and backend.duration:
            began = 0.0, network.start_state
            self.stepper: Stepper = DrivenStepper(drive, method, backend.duration, began)
            return
        self.stepper = stepper_of(
            self.compiled,
            method,
            rhs,
            self._ends(method),
            cells=backend.cells,
            guard=self.guard,
            first=FIRST_STEP * self.fastest,
        )

    def _ends(self, method: Method) -> Ends:
        settling = self.backend.settling
        return Ends(
            until=self.backend._until(self.network, self.fastest),
            settled=settling.confirmed if self.backend.duration is None else 0.0,
            largest=self.largest,
            rtol=method.rtol,
            atol=method.atol,
            tolerance=settling.tolerance,
        )

    def run(self) -> Run:
        """Integrate until the outcome is known."""
        ended, paced = None, Paced(self.backend.progress)
        with np.errstate(all="ignore"):
            while ended is None:
                ended = self._piece()
                try:
                    paced(self._line)
                except Stopped as end:
                    ended = ended or self._reported(status.stopped, str(end))
        stepper, settling = self.stepper, self.backend.settling
        end = stepper.time, stepper.state, ended, settling, stepper.evaluations
        return self.recorder.run(*end, between=stepper.between, exit=stepper.exit)

    def _line(self) -> str:
        worst = max(self.recorder.residuals[-1])
        name = status.residual_name(self.network)
        return f"{self.stepper.time:.4g} unit time constants, {name} {worst:.1e}"

    def _piece(self) -> Status | None:
        """Take more steps, up to the next headway check."""
        recorder, most_steps = self.recorder, self.backend.most_steps
        most = min(every - recorder.steps % every for every in (CRAWL, window_of(most_steps)))
        if self.backend.duration is None:
            most = min(most, most_steps - recorder.steps)
        recorder.record_all(*self.stepper.steps(most))
        stepper, worst = self.stepper, max(recorder.residuals[-1])
        is_over = self.backend.duration is None or stepper.at_end
        if is_over and worst < self.backend.settling.confirmed:
            return status.settled(worst, stepper.time, status.residual_name(self.network))
        return self._failure(stepper.state, stepper.time)

    def _failure(self, x: np.ndarray, now: float) -> Status | None:
        failed, beyond = self.stepper.failed, self.stepper.beyond
        if beyond is None and (failed or not float(np.abs(x).max()) < self.largest):
            return status.diverged(self.network, x, now, failed)
        block, stage = self.compiled.outside(x if beyond is None else beyond, self.guard)
        if block >= 0:
            return status.left_domain(self.network, block, stage, now)
        if failed:
            return status.diverged(self.network, x, now, failed)
        if self.backend.duration is not None:
            return self._reported(status.completed) if self.stepper.at_end else None
        if why := self._time_is_up(x, now):
            return self._reported(status.not_settled, why)
        return (how := self._no_headway(now)) and self._reported(status.stalled, *how)

    def _reported(self, how: Callable[..., Status], *why: str) -> Status:
        name = status.residual_name(self.network)
        return how(self.recorder.residuals[-1], self.stepper.time, *why, name=name)

    def _no_headway(self, now: float) -> tuple[str, str] | None:
        """Return the sign of a run without headway, and advice; checked once per window."""
        advice = status.elsewhere(self.network)
        recorder, window = self.recorder, window_of(self.backend.most_steps)
        steps, times = recorder.steps, recorder.residual_times
        if steps % CRAWL == 0 and now - times[-1 - CRAWL] < self.fastest:
            neuron = self.network.label(int(np.abs(self.rhs(self.stepper.state)).argmax()))
            why = f"steps became very short where neuron {neuron} changes fast"
            return why, advice if self.method.implicit else status.LONGER_STEPS
        if steps % window or steps < 3 * window:
            return None
        worst = np.array(recorder.residuals[-2 * window :]).max(axis=1)
        if np.nanmin(worst[window:]) < HEADWAY * np.nanmin(worst[:window]):
            return None
        states, least = recorder.last_states(window), float(np.nanmin(worst[window:]))
        return status.no_headway(self.network, states, window, least, self.method)

    def _time_is_up(self, x: np.ndarray, now: float) -> str | None:
        """Return the bound that ended the run, if any.

        The fastest rate at the start may differ from that at the equilibrium, by which the default
        limit counts.
        """
        if self.recorder.steps >= self.backend.most_steps:
            return f"{self.recorder.steps} integration steps (most_steps)"
        if not self.stepper.at_end:
            return None
        limit = self.backend.limit
        if limit is None:
            end = LIMIT / self.compiled.fastest_rate(x)
            if end > now * (1 + 1e-9):
                self.stepper.go_on(end)
                return None
        return f"{limit or LIMIT:g} tau_min (limit)"
