"""Many networks at once: samples of one network in generated code, a lane each, on all cores.

Slices of the batch go from thread to thread; within one, a sample that is done makes room for the
next (`backends.lanes`).
"""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor, wait
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from ann_dc.backends.batch import BatchRun
from ann_dc.backends.batch_recorder import BatchCurves
from ann_dc.backends.integration.integrator import (
    OUTSIDE,
    OVERFLOWN,
    SETTLED,
    TIME_UP,
    TOO_SHORT,
)
from ann_dc.backends.lanes.group import OPEN, STALLED, Found, Group, Samples, hand_over
from ann_dc.backends.lanes.memory import CONSTRAINT, DONE, STATIONARITY
from ann_dc.backends.lanes.samples import samples_of
from ann_dc.backends.status import Outcome
from ann_dc.errors import NetworkError
from ann_dc.evaluation.codegen.lanes import Lanes
from ann_dc.evaluation.codegen.plan import Axis, refusal
from ann_dc.evaluation.reference import evaluator
from ann_dc.evaluation.variant_numbers import Numbers
from ann_dc.network.network import Network
from ann_dc.progress import Paced, Progress, Stopped
from ann_dc.resources import cores

SMALLEST_SLICE, LARGEST_SLICE = 64, 4096
"""Samples that a thread takes at a time."""
ATTEMPTS = 2000
"""Steps of a group of lanes between two looks at whether somebody ended the run, at most."""
NUMBERS = 20_000_000
"""Numbers of states that these steps have at most: a twentieth of a second, or a step."""
PACE = 0.1
"""Seconds between two looks at what there is to tell."""
OUTCOMES = {
    SETTLED: Outcome.SETTLED,
    OVERFLOWN: Outcome.DIVERGED,
    TOO_SHORT: Outcome.DIVERGED,
    OUTSIDE: Outcome.LEFT_DOMAIN,
    TIME_UP: Outcome.NOT_SETTLED,
    STALLED: Outcome.STALLED,
    OPEN: Outcome.STOPPED,
}


class Thread(NamedTuple):
    """What a thread works with."""

    group: Group
    """Where its samples are."""
    advance: Callable[[Samples, Found, np.ndarray], bool]
    """Some more work on samples; a queue tells the next and the end. Whether all is done."""
    locate: Callable[[Samples, Found, np.ndarray], None] | None = None
    """Locates when residuals of samples fell below the tolerance; None for recurrent steps."""


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
    """Run one copy of a network for each sample of its inputs.

    Parameters
    ----------
    network : Network
    inputs : mapping of input name to number, (B,) or (B, N) array
    x : (n,) or (B, n) array, optional
        Where to start, in network units.
    begin : callable
        What a thread does with lanes of its own.
    numbers : Numbers, optional
        Weights and rates of every sample.
    curves : int
        States to keep of every sample.
    threads : int, optional
        By default as many as there are cores for this process.
    progress : Progress

    Returns
    -------
    BatchRun

    Raises
    ------
    UnknownNameError, NetworkError
        If an input does not exist, sizes do not agree, the numbers do not fit the network, or no
        code is generated for the wiring.
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
    work = _Work(begin, samples, found, iter(range(0, count, size)), size)
    work.run([first, *(first.beside() for _ in range(threads - 1))], Paced(progress))
    is_open = found.codes == OPEN
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


def _nothing(_: Group) -> None:
    pass


def attempts_of(network: Network) -> int:
    """Steps of a group of lanes between two looks at whether somebody ended the run."""
    numbers = Axis.SAMPLES.lanes * max(network.size, 1)
    return int(np.clip(NUMBERS // numbers, 1, ATTEMPTS))


@dataclass(frozen=True, eq=False)
class _Work:
    """A batch under way, whose slices threads take in turn."""

    begin: Callable[[Lanes], Thread]
    samples: Samples
    found: Found
    slices: Iterator[int]
    size: int
    is_over: threading.Event = field(default_factory=threading.Event)

    def run(self, every_lanes: list[Lanes], paced: Paced) -> None:
        """A thread for each of these lanes, until all is done or somebody ends it."""
        with contextlib.suppress(Stopped):
            if len(every_lanes) == 1:
                self._serve(every_lanes[0], lambda group: paced(lambda: self._line(group)))
            else:
                self._share(every_lanes, paced)

    def _share(self, every_lanes: list[Lanes], paced: Paced) -> None:
        with ThreadPoolExecutor(len(every_lanes)) as pool:
            left = {pool.submit(self._serve, lanes, _nothing) for lanes in every_lanes}
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
        running = int((self.found.codes == OPEN).sum())
        told = f"{running} of {len(self.found.codes)} samples run on"
        if group is None or len(self.found.codes) > 1 or not running:
            return told
        done, *residuals = group.memory[[DONE, CONSTRAINT, STATIONARITY]].max(axis=1)
        return f"step {done:.0f}, KKT residual {max(residuals):.1e}: {told}"


def _curves(found: Found) -> BatchCurves:
    """Every sample's rows, one after the other; where it starts, if it never began."""
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
