"""Results of a batch of runs: one network with many samples of inputs or numbers.

Each sample may differ in inputs or numbers and has a separate outcome. Samples do not wait for or
affect each other: a sample that diverges or has a non-finite input fails alone and is reported by
its number.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from ann_dc.backends.integration.methods import Between
from ann_dc.backends.status import Outcome, residual_name
from ann_dc.backends.trajectory import Trajectory
from ann_dc.errors import NetworkError
from ann_dc.evaluation.variant_numbers import Numbers
from ann_dc.network.network import Network
from ann_dc.network.waveforms import Waveform
from ann_dc.si_prefixes import counted
from ann_dc.summaries import extent, summarised

_Check = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]
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
    """Recorder of a batch in bounded memory: at most so many records, at least 2, and the ends.

    All running samples are recorded together. Above the maximum, every second record is dropped and
    only every second check is recorded from then on, as in a single run. A finished sample retains
    its records, however long the other samples run.

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
        self._checks: list[_Check] = []
        self._done: list[_Check] = []
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
            self._checks.append((samples, time, states, residuals))
        self._seen += 1
        if len(self._checks) > self.most:
            self._thin(samples)

    def _thin(self, running: np.ndarray) -> None:
        """Drop every second record of the running samples."""
        for look in self._checks[1::2]:
            done = ~np.isin(look[0], running)
            if done.any():
                samples, time, states, residuals = look
                self._done.append((samples[done], time[done], states[done], residuals[done]))
        self._checks, self._stride = self._checks[::2], 2 * self._stride

    def curves(self, states: np.ndarray, residuals: np.ndarray) -> BatchCurves:
        """Return all trajectories with their final states (B, n) and residuals (B, 2).

        A final state replaces a record of the same time.
        """
        end = np.arange(len(self._last)), self._last, states, residuals
        columns = [np.concatenate(parts) for parts in zip(*self._done, *self._checks, end)]
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


@summarised(
    lambda self: {
        "network": self.network.title,
        "samples": len(self.outcomes),
        "settled": f"{np.count_nonzero(self.settled)} of {len(self.outcomes)}",
        "steps": extent(self.steps),
        "settling times": extent(self.settling_times),
    }
)
@dataclass(frozen=True, kw_only=True, eq=False)
class BatchRun:
    """Runs of many copies of a network with different inputs or numbers.

    Attributes
    ----------
    network : Network
        Network of which all samples are copies.
    inputs : dict of str to (B, N) array
        Every input of every sample, as in ``network.inputs``; at time zero if it changes.
    states : (B, n) array
        Final state vectors in network units.
    outcomes : tuple of Outcome
        Outcome of each sample.
    steps : (B,) integers
        Number of recurrent or integration steps.
    settling_steps : (B,) integers
        Steps after which the KKT residual stays below the tolerance; -1 if the sample did not
        settle. A recurrence checks every `CHECK` steps (`CHECK_ON_GPU` on a GPU).
    settling_times : (B,) array
        Network time after which the residual stays below the tolerance; nan if the sample did not
        settle.
    residuals : (B, 2) array
        Relative constraint and stationarity residuals at the end.
    curves : BatchCurves or None
        Trajectories of the samples, if the backend was asked to store them; see `trajectory`.
    numbers : Numbers or None
        Weights and rates of every sample, if they differ from those of the network.
    waveforms : mapping of str to Waveform
        Inputs over time with values (K, B or 1, N or 1).

    Examples
    --------
    >>> import ann_dc
    >>> network = ann_dc.design(ann_dc.plants.double_integrator(N=3)).network
    >>> backend = ann_dc.RecurrentBackend(acceleration=ann_dc.Anderson())
    >>> batch = backend.run_batch(network, {"q_d.x": [0.5, 1.0, float("nan")]})
    >>> batch.settled.tolist()
    [True, True, False]
    >>> batch.message(2)
    'sample 2: input q_d.x is not a finite number'
    """

    network: Network
    inputs: dict[str, np.ndarray]
    states: np.ndarray
    outcomes: tuple[Outcome, ...]
    steps: np.ndarray
    settling_steps: np.ndarray
    settling_times: np.ndarray
    residuals: np.ndarray
    curves: BatchCurves | None = None
    numbers: Numbers | None = None
    waveforms: Mapping[str, Waveform] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.states)

    @property
    def settled(self) -> np.ndarray:
        """Boolean mask (B,) of the samples that settled."""
        return np.array([outcome is Outcome.SETTLED for outcome in self.outcomes])

    def network_of(self, sample: int) -> Network:
        """Return the network with the inputs and numbers of one sample.

        Raises `NetworkError` if an input or number is not finite.
        """
        network = self.network
        if self.numbers is not None:
            own = range(len(self))[sample] if len(self.numbers) > 1 else 0
            network = self.numbers.network_of(network, own)
        inputs = {name: v[sample] for name, v in self.inputs.items()}
        return network.with_inputs(inputs | self._waveforms_of(range(len(self))[sample]))

    def _waveforms_of(self, sample: int) -> dict[str, Waveform]:
        """Return the inputs over time of one sample, with values (K, N or 1)."""
        found = {}
        for name, one in self.waveforms.items():
            values = one.values[:, sample if one.values.shape[1] > 1 else 0]
            values = np.broadcast_to(values, (len(values), self.network.stages))
            found[name] = replace(one, values=values)
        return found

    def trajectory(self, sample: int) -> Trajectory:
        """Return the states of one sample over network time, as in a single run.

        Raises `NetworkError` if no curves were stored or if an input of the sample is not finite.

        Examples
        --------
        >>> import ann_dc
        >>> network = ann_dc.design(ann_dc.plants.double_integrator(N=3)).network
        >>> backend = ann_dc.RecurrentBackend(curves=100)
        >>> batch = backend.run_batch(network, {"q_d.x": [0.5, 1.0]})
        >>> trajectory = batch.trajectory(1)
        >>> bool((trajectory.final == batch.states[1]).all()), len(trajectory.time) > 10
        (True, True)
        """
        if self.curves is None:
            raise NetworkError(
                "trajectory: the batch stored no trajectories; run it with a backend that has "
                "curves=200, the number of stored states per sample"
            )
        return self.curves.trajectory(sample, self.network_of(sample))

    def completed(self) -> BatchRun:
        """Return the batch as one of a given duration, which its samples had to complete."""
        outcomes = (Outcome.COMPLETED if o is Outcome.NOT_SETTLED else o for o in self.outcomes)
        return replace(self, outcomes=tuple(outcomes))

    def with_between(self, between: Callable[..., Between]) -> BatchRun:
        """Return the batch with states known at every time; see `Trajectory.at`.

        The callable ``between`` is that of `BatchCurves`.
        """
        if self.curves is None:
            return self
        return replace(self, curves=replace(self.curves, between=between))

    def message(self, sample: int) -> str:
        """Return one sentence on how a sample ended."""
        bad = [name for name, v in self.inputs.items() if not np.isfinite(v[sample]).all()]
        if bad:
            return f"sample {sample}: input {', '.join(bad)} is not a finite number"
        ended = self.outcomes[sample]
        what = f"sample {sample}: {ended.value}, after {self.steps[sample]} steps"
        if ended is Outcome.DIVERGED:
            x = self.states[sample]
            worst = int(np.argmax(np.where(np.isfinite(x), np.abs(x), np.inf)))
            return f"{what}: neuron {self.network.label(worst)} reached {x[worst]:.3g}"
        return f"{what}, {residual_name(self.network)} {self.residuals[sample].max():.1e}"

    def __str__(self) -> str:
        settled, count = self.settled, counted(len(self), "samples")
        completed = np.array([outcome is Outcome.COMPLETED for outcome in self.outcomes])
        lines = [f"{settled.sum()} of {count} settled"]
        if settled.any():
            steps = self.settling_steps[settled]
            lines[0] += f", in {int(np.median(steps))} steps (median), at most {steps.max()}"
        if completed.any():
            lines[0] += f", {completed.sum()} completed the given duration"
        lost = np.flatnonzero(~(settled | completed))
        lines += [f"  {self.message(sample)}" for sample in lost[:10]]
        lines += [f"  and {len(lost) - 10} more"] if len(lost) > 10 else []
        return "\n".join(lines)
