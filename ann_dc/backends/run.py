"""The contract of a backend: a network goes in, a run comes out, whatever runs it."""

from __future__ import annotations

from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any, Protocol

import numpy as np

from ann_dc.backends.status import Status
from ann_dc.backends.trajectory import Trajectory
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.base import Kind
from ann_dc.progress import Deadline
from ann_dc.validation.values import such_as


@dataclass(frozen=True, kw_only=True, eq=False)
class Run:
    """One run of a network on a backend.

    Attributes
    ----------
    trajectory : Trajectory
        States and residuals over network time.
    status : Status
        How it ended, in a sentence.
    tolerance : float
        On the relative KKT residual.
    settling_time : float
        Network time after which the residual stays below the tolerance; nan if it never does.
    verified : str
        How the settling time was checked.
    steps, evaluations : int
        Integration or recurrent steps, and right-hand sides (a recurrent step counts as one).

    Examples
    --------
    >>> import ann_dc
    >>> network = ann_dc.design(ann_dc.plants.double_integrator(N=5)).network
    >>> run = ann_dc.OdeBackend(verify=False).run(network)
    >>> run.trajectory["u.a"].shape == (len(run.trajectory.time), network.stages)
    True
    >>> run.settling_steps < run.steps
    True
    """

    trajectory: Trajectory
    status: Status
    tolerance: float
    settling_time: float
    verified: str
    steps: int
    evaluations: int

    @property
    def settling_steps(self) -> int | None:
        """Steps after which the residual stays below the tolerance; None if it never does.

        Of thousands of steps a record may have every second, or fourth, or so: then this is as
        exact as the record.
        """
        if not np.isfinite(self.settling_time):
            return None
        times = self.trajectory.residual_time
        between = self.steps / max(len(times) - 1, 1)
        return round(between * int((times < self.settling_time).sum()))


@such_as("ann_dc.OdeBackend()")
class Backend(Protocol):
    """What runs a network from its start until it settles, or cannot.

    1. `run` starts from ``network.start_state`` and takes everything from the network: a backend
       has no equations of its own and no memory of the run before.
    2. It raises for a network that it cannot run; how a run ends is told by ``Run.status``.
    3. Time is network time, states and residuals are those of the network, whatever the backend
       counts in.
    4. `kinds` are the metrics that a network which is designed for it may have.
    5. It is a record, and if it takes long it tells its field ``progress``; where that raises
       `Stopped`, the run ends, with what there is.
    """

    @property
    def kinds(self) -> tuple[Kind, ...]:
        """Metrics among which a design for this backend chooses, unless told otherwise."""
        ...

    def run(self, network: Network) -> Run:
        """The whole run, whatever its outcome."""
        ...


def within(backend: Backend, deadline: Deadline) -> Backend:
    """The same backend, which ends when a deadline says so.

    Parameters
    ----------
    backend : Backend
        That tells its progress, or is left as it is.
    deadline : Deadline
    """
    if not (is_dataclass(backend) and "progress" in {field.name for field in fields(backend)}):
        return backend
    record: Any = backend

    def progress(line: str) -> None:
        deadline.check()
        record.progress(line)

    return replace(record, progress=progress)
