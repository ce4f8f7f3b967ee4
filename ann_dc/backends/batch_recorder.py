"""Takes a batch down, look by look: where every sample that still ran was, in bounded memory.

All samples are looked at together. Beyond so many looks every second one is dropped, and only every
second one taken from then on, as in the record of a single run; but a sample that is done keeps
what it had, however long the others go on, and every sample keeps its end.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ann_dc.backends.integration.methods import Between
from ann_dc.backends.trajectory import Trajectory
from ann_dc.network.network import Network

Look = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]
"""(b,) samples, (b,) network times, (b, n) states, (b, 2) residuals."""


@dataclass(frozen=True, kw_only=True, eq=False)
class BatchCurves:
    """Where B samples were on their way, one after the other.

    Attributes
    ----------
    first : (B + 1,) integers
        Row at which each sample begins, and the number of all rows.
    time : (S,) array
        Network time.
    states : (S, n) array
        In network units.
    residuals : (S, 2) array
        Relative constraint and stationarity residuals.
    between : callable or None
        Gives states between the steps of a sample, from its ``network``; None of recurrent steps.
    """

    first: np.ndarray
    time: np.ndarray
    states: np.ndarray
    residuals: np.ndarray
    between: Callable[..., Between] | None = None

    def trajectory(self, sample: int, network: Network) -> Trajectory:
        """The curve of a sample.

        Parameters
        ----------
        sample : int
            From 0, or from the end where it is negative.
        network : Network
            With the inputs of the sample.

        Returns
        -------
        Trajectory
            Its residuals are those of its samples.
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
    """Takes down a batch.

    Parameters
    ----------
    count : int
        B, the number of samples.
    most : int
        Looks that are kept, at least 2, besides the ends.

    Examples
    --------
    Two samples, of which the second is done after the first look:

    >>> recorder = BatchRecorder(2, most=10)
    >>> row = lambda *values: np.array(values, float)
    >>> recorder.record(np.array([0, 1]), row(0, 0), row(1, 2)[:, None], np.ones((2, 2)))
    >>> recorder.record(np.array([0]), row(0.5), row(3)[:, None], np.ones((1, 2)))
    >>> curves = recorder.curves(row(3, 2)[:, None], np.ones((2, 2)))
    >>> curves.first.tolist(), curves.states[:, 0].tolist()
    ([0, 2, 3], [1.0, 3.0, 2.0])
    """

    def __init__(self, count: int, most: int) -> None:
        self.most = most
        self._looks: list[Look] = []
        self._done: list[Look] = []
        self._seen, self._stride = 0, 1
        self._last = np.zeros(count)

    def record(self, samples, time, states, residuals) -> None:
        """Take down the samples that still run.

        Parameters
        ----------
        samples : (b,) integers
            Which they are.
        time : (b,) array
            Network time.
        states : (b, n) array
            In network units.
        residuals : (b, 2) array
        """
        self._last[samples] = time
        if self._seen % self._stride == 0:
            self._looks.append((samples, time, states, residuals))
        self._seen += 1
        if len(self._looks) > self.most:
            self._thin(samples)

    def _thin(self, running: np.ndarray) -> None:
        """Drop every second look of the samples that run."""
        for look in self._looks[1::2]:
            done = ~np.isin(look[0], running)
            if done.any():
                samples, time, states, residuals = look
                self._done.append((samples[done], time[done], states[done], residuals[done]))
        self._looks, self._stride = self._looks[::2], 2 * self._stride

    def curves(self, states: np.ndarray, residuals: np.ndarray) -> BatchCurves:
        """All curves, each with its end.

        Parameters
        ----------
        states : (B, n) array
            Last states; they stand for what was taken down at the same time.
        residuals : (B, 2) array
            At the end.

        Returns
        -------
        BatchCurves
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
