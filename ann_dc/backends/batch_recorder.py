"""Recording of a batch in bounded memory, with all running samples at each check.

All samples are recorded together. Above a maximum number of records every second one is dropped and
only every second check is recorded from then on, as in a single run. A finished sample retains its
records, however long the other samples run, and every sample retains its final state.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ann_dc.backends.integration.methods import Between
from ann_dc.backends.trajectory import Trajectory
from ann_dc.network.network import Network

_Look = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]
"""Samples (b,), network times (b,), states (b, n) and residuals (b, 2) of one check."""


@dataclass(frozen=True, kw_only=True, eq=False)
class BatchCurves:
    """Trajectories of B samples, concatenated.

    ``first`` (B + 1,) contains the first row of each sample and the number of all rows. ``between``
    returns states between the steps of a sample from its ``network``; None for recurrent steps.
    """

    first: np.ndarray
    time: np.ndarray
    states: np.ndarray
    residuals: np.ndarray
    between: Callable[..., Between] | None = None

    def trajectory(self, sample: int, network: Network) -> Trajectory:
        """Return the trajectory of a sample, which ends before the first row of the next.

        The network has the inputs of the sample.
        """
        number = range(len(self.first) - 1)[sample]
        rows = slice(self.first[number], self.first[number + 1])
        time = self.time[rows]
        found = Trajectory(
            network=network,
            time=time,
            states=self.states[rows],
            residual_time=time,
            residuals=self.residuals[rows],
        )
        return found.with_between(self.between(network=network)) if self.between else found


class BatchRecorder:
    """Recorder of a batch with at most so many records, at least 2, and the final states.

    Examples
    --------
    Two samples, of which the second ends after the first check:

    >>> recorder = BatchRecorder(most=10)
    >>> row = lambda *values: np.array(values, float)
    >>> recorder.record(np.array([0, 1]), row(0, 0), row(1, 2)[:, None], np.ones((2, 2)))
    >>> recorder.record(np.array([0]), row(0.5), row(3)[:, None], np.ones((1, 2)))
    >>> curves = recorder.curves(row(3, 2)[:, None], np.ones((2, 2)))
    >>> curves.first.tolist(), curves.states[:, 0].tolist()
    ([0, 2, 3], [1.0, 3.0, 2.0])
    """

    def __init__(self, most: int) -> None:
        self.most = most
        self._looks: list[_Look] = []
        self._done: list[_Look] = []
        self._seen, self._stride = 0, 1
        self._last = np.zeros(0)

    def record(self, samples, time, states, residuals) -> None:
        """Record the running samples (b,), at first all, at network times (b,).

        The states (b, n) are in network units, and the residuals have shape (b, 2).
        """
        if not self._seen:
            self._last = np.zeros(len(samples))
        self._last[samples] = time
        if self._seen % self._stride == 0:
            self._looks.append((samples, time, states, residuals))
        self._seen += 1
        if len(self._looks) > self.most:
            self._thin(samples)

    def _thin(self, running: np.ndarray) -> None:
        """Drop every second record of the running samples."""
        for look in self._looks[1::2]:
            done = ~np.isin(look[0], running)
            if done.any():
                samples, time, states, residuals = look
                self._done.append((samples[done], time[done], states[done], residuals[done]))
        self._looks, self._stride = self._looks[::2], 2 * self._stride

    def curves(self, states: np.ndarray, residuals: np.ndarray) -> BatchCurves:
        """Return all trajectories with their final states (B, n) and residuals (B, 2).

        A final state replaces a record of the same time.
        """
        end = np.arange(len(self._last)), self._last, states, residuals
        columns = [np.concatenate(parts) for parts in zip(*self._done, *self._looks, end)]
        order = np.lexsort((columns[1], columns[0]))
        sample, time = columns[0][order], columns[1][order]
        # a sample's end comes last, and is what counts at its time
        counts = np.append((np.diff(sample) != 0) | (np.diff(time) != 0), True)
        sample, rows = sample[counts], order[counts]
        return BatchCurves(
            first=np.searchsorted(sample, np.arange(len(self._last) + 1)),
            time=columns[1][rows],
            states=columns[2][rows],
            residuals=columns[3][rows],
        )
