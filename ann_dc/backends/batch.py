"""Results of a batch of runs: one network with many samples of inputs or numbers.

Each sample may differ in inputs or numbers and has a separate outcome. Samples do not wait for or
affect each other: a sample that diverges or has a non-finite input fails alone and is reported by
its number.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ann_dc.backends.batch_recorder import BatchCurves
from ann_dc.backends.integration.methods import Between
from ann_dc.backends.status import Outcome
from ann_dc.backends.trajectory import Trajectory
from ann_dc.errors import NetworkError
from ann_dc.evaluation.variant_numbers import Numbers
from ann_dc.network.network import Network
from ann_dc.si_prefixes import counted


@dataclass(frozen=True, kw_only=True, eq=False)
class BatchRun:
    """Runs of many copies of a network with different inputs or numbers.

    Attributes
    ----------
    network : Network
        Network of which all samples are copies.
    inputs : dict of str to (B, N) array
        Every input of every sample, as in ``network.inputs``.
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
        return network.with_inputs({name: v[sample] for name, v in self.inputs.items()})

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
                "trajectory: this batch kept no curves; run it with a backend that has "
                "curves=200, the number of states to keep of every sample"
            )
        return self.curves.trajectory(sample, self.network_of(sample))

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
        return f"{what}, KKT residual {self.residuals[sample].max():.1e}"

    def __str__(self) -> str:
        settled = self.settled
        lines = [f"{settled.sum()} of {counted(len(self), 'samples')} settled"]
        if settled.any():
            steps = self.settling_steps[settled]
            lines[0] += f", in {int(np.median(steps))} steps (median), at most {steps.max()}"
        lost = np.flatnonzero(~settled)
        lines += [f"  {self.message(sample)}" for sample in lost[:10]]
        lines += [f"  and {len(lost) - 10} more"] if len(lost) > 10 else []
        return "\n".join(lines)
