"""Batches of samples in generated code: one sample per SIMD lane, on all cores.

The batch is divided into slices that threads take in turn. Within a slice, a finished sample is
replaced by the next sample (`backends.batched`).
"""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor, wait
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from ann_dc.backends.batch import BatchCurves, BatchRun
from ann_dc.backends.batched.group import Ends, Found, Group, Samples, hand_over
from ann_dc.backends.batched.memory import CONSTRAINT, DONE, STATIONARITY
from ann_dc.backends.batched.samples import samples_of
from ann_dc.backends.integration.integrator import (
    DIVERGED,
    LEFT_DOMAIN,
    RUNNING,
    SETTLED,
    STALLED,
    TIME_UP,
    TOO_SHORT,
)
from ann_dc.backends.settling import HEADWAY, Settling, window_of
from ann_dc.backends.status import OVERFLOW, Outcome, residual_name
from ann_dc.errors import NetworkError
from ann_dc.evaluation.codegen.lanes import Lanes
from ann_dc.evaluation.codegen.plan import Axis, refusal
from ann_dc.evaluation.reference import evaluator
from ann_dc.evaluation.variant_numbers import Numbers
from ann_dc.network.network import Network
from ann_dc.progress import Paced, Progress, Stopped
from ann_dc.resources import cores

SMALLEST_SLICE, LARGEST_SLICE = 64, 4096
"""Smallest and largest number of samples that a thread takes at a time."""
ATTEMPTS = 2000
"""Largest number of steps of a lane group between two checks for an interrupt."""
NUMBERS = 20_000_000
"""Largest number of state values computed between two checks: a twentieth of a second, or one step.
"""
PACE = 0.1
"""Seconds between two checks for progress to report."""
OUTCOMES = {
    SETTLED: Outcome.SETTLED,
    DIVERGED: Outcome.DIVERGED,
    TOO_SHORT: Outcome.DIVERGED,
    LEFT_DOMAIN: Outcome.LEFT_DOMAIN,
    TIME_UP: Outcome.NOT_SETTLED,
    STALLED: Outcome.STALLED,
    RUNNING: Outcome.STOPPED,
}
"""Outcome of a sample by its code."""


class Thread(NamedTuple):
    """Resources and functions of one thread."""

    group: Group  # lane group with the samples of the thread
    advance: Callable[[Samples, Found, np.ndarray], bool]
    """Function that advances samples; its queue gives the next and the end.

    Returns True if all are done.
    """
    locate: Callable[[Samples, Found, np.ndarray], None] | None = None
    """Function that locates when residuals fell below the tolerance; None for recurrent steps."""


def ends_of(settling: Settling, most_steps: int) -> Ends:
    """Return the end conditions of a sample with a largest number of steps."""
    return Ends(
        tolerance=settling.tolerance,
        settled=settling.confirmed,
        overflow=OVERFLOW,
        most_steps=most_steps,
        window=window_of(most_steps),
        headway=HEADWAY,
    )


def run_lanes(
    network: Network,
    inputs: Mapping[str, object],
    x: np.ndarray | None,
    begin: Callable[[Lanes], Thread],
    *,
    numbers: Numbers | None,
    curves: int,
    threads: int | None,
    progress: Progress,
) -> BatchRun:
    """Run one copy of a network for each sample, on all cores by default.

    ``begin`` makes the `Thread` of a thread's lanes. Raises `UnknownNameError` if an input does not
    exist. Raises `NetworkError` if sizes do not agree, if the numbers do not fit the network, or if
    no code is generated for the wiring.
    """
    tape = evaluator(network).tape
    if why := refusal(tape):
        raise NetworkError(f"run_batch: no code is generated for this network: {why}")
    if numbers is not None:
        numbers.check(network)
    first = Lanes(tape, Axis.SAMPLES if numbers is None else Axis.VARIANTS)
    samples, every = samples_of(network, first.plan, inputs, x, numbers)
    count = len(samples.states)
    found = Found.of(samples.states, curves)
    threads = max(min(threads or cores(), count // SMALLEST_SLICE), 1)
    size = min(max(-(-count // (2 * threads)), SMALLEST_SLICE), LARGEST_SLICE)
    slices = iter(range(0, count, size))
    work = _Work(begin, samples, found, slices, size, residual_name(network))
    work.run([first, *(first.beside() for _ in range(threads - 1))], Paced(progress))
    is_open = found.codes == RUNNING
    found.steps[is_open, 1], found.times[is_open, 1] = -1, np.nan
    return BatchRun(
        network=network,
        inputs=every,
        states=found.states,
        outcomes=tuple(OUTCOMES[code] for code in found.codes.tolist()),
        steps=found.steps[:, 0],
        settling_steps=found.steps[:, 1],
        settling_times=found.times[:, 1],
        residuals=found.residuals,
        curves=_curves(found) if curves else None,
        numbers=numbers,
    )


def attempts_of(network: Network) -> int:
    """Return the number of steps of a lane group between two checks for an interrupt."""
    numbers = Axis.SAMPLES.lanes * max(network.size, 1)
    return int(np.clip(NUMBERS // numbers, 1, ATTEMPTS))


@dataclass(frozen=True, eq=False)
class _Work:
    """Batch in progress, whose slices threads take in turn."""

    begin: Callable[[Lanes], Thread]
    samples: Samples
    found: Found
    slices: Iterator[int]
    size: int
    residual: str  # its name in progress lines
    is_over: threading.Event = field(default_factory=threading.Event)

    def run(self, every_lanes: list[Lanes], paced: Paced) -> None:
        """Run one thread per lane set until all samples are done or an interrupt."""
        with contextlib.suppress(Stopped):
            if len(every_lanes) == 1:
                self._serve(every_lanes[0], lambda group: paced(lambda: self._line(group)))
            else:
                self._share(every_lanes, paced)

    def _share(self, every_lanes: list[Lanes], paced: Paced) -> None:
        with ThreadPoolExecutor(len(every_lanes)) as pool:
            left = {pool.submit(self._serve, lanes, lambda _: None) for lanes in every_lanes}
            try:
                while left:
                    done, left = wait(left, timeout=PACE)
                    for future in done:
                        future.result()
                    paced(self._line)
            finally:
                self.is_over.set()

    def _serve(self, lanes: Lanes, between: Callable[[Group], None]) -> None:
        thread = self.begin(lanes)
        for begin in self.slices:
            queue = np.array([begin, min(begin + self.size, len(self.samples.states))])
            part, is_done = slice(*queue), False
            try:
                while not (is_done or self.is_over.is_set()):
                    is_done = thread.advance(self.samples, self.found, queue)
                    between(thread.group)
            finally:
                hand_over(thread.group, self.found)
                self._locate(thread, part)

    def _locate(self, thread: Thread, part: slice) -> None:
        """Locate the times at which residuals of settled samples fell below the tolerance."""
        is_known = np.isfinite(self.found.spans[part, 0]) & (self.found.codes[part] == SETTLED)
        if thread.locate is not None and is_known.any():
            thread.locate(self.samples, self.found, part.start + np.flatnonzero(is_known))

    def _line(self, group: Group | None = None) -> str:
        running = int((self.found.codes == RUNNING).sum())
        reported = f"{running} of {len(self.found.codes)} samples still run"
        if group is None or len(self.found.codes) > 1 or not running:
            return reported
        done, *residuals = group.memory[[DONE, CONSTRAINT, STATIONARITY]].max(axis=1)
        return f"step {done:.0f}, {self.residual} {max(residuals):.1e}: {reported}"


def _curves(found: Found) -> BatchCurves:
    """Return the concatenated rows of all samples.

    A sample that never began has only its start.
    """
    waiting = found.curve_sizes == 0
    found.curve_sizes[waiting], found.curves[waiting, 0] = 1, found.states[waiting]
    found.curve_residuals[waiting, 0] = np.inf
    chosen = np.arange(found.curve_times.shape[1]) < found.curve_sizes[:, None]
    return BatchCurves(
        first=np.concatenate([[0], np.cumsum(found.curve_sizes)]),
        time=found.curve_times[chosen],
        states=found.curves[chosen],
        residuals=found.curve_residuals[chosen],
    )
