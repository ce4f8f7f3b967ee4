"""Contract of a backend: a function from a network to a run."""

from __future__ import annotations

from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any, Protocol

import numpy as np

from ann_dc.backends.status import Status
from ann_dc.backends.trajectory import Trajectory
from ann_dc.errors import such_as
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.base import PreconditionerKind
from ann_dc.progress import Deadline, Progress, silent
from ann_dc.summaries import summarised


@summarised(
    lambda self: {
        "status": self.status,
        "settling time": f"{self.settling_time:.4g}",
        "steps": self.steps,
        "evaluations": self.evaluations,
    }
)
@dataclass(frozen=True, kw_only=True, eq=False)
class Run:
    """Result of one run of a network on a backend.

    Attributes
    ----------
    trajectory : Trajectory
        States and residuals over network time.
    status : Status
        Outcome of the run, with a sentence that describes it.
    tolerance : float
        Tolerance on the relative KKT residual.
    settling_time : float
        Network time after which the residual stays below the tolerance; nan if it never does. With
        inputs over time the residual is that of the inputs at each time, so this is also the time
        after which the network follows them.
    verified : str
        Description of the check of the settling time.
    steps, evaluations : int
        Number of integration or recurrent steps, and number of right-hand sides. A recurrent step
        counts as one right-hand side.

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
        """Number of steps after which the residual stays below the tolerance.

        None if the residual never stays below it. The record of a run with thousands of steps may
        contain only every second or fourth step, for example; the number is then as exact as the
        record.
        """
        if not np.isfinite(self.settling_time):
            return None
        times = self.trajectory.residual_time
        between = self.steps / max(len(times) - 1, 1)
        return round(between * int((times < self.settling_time).sum()))


@such_as("ann_dc.OdeBackend()")
class Backend(Protocol):
    """Protocol of a backend, which runs a network until it settles or cannot settle.

    1. `run` starts from ``network.start_state`` and takes everything from the network: a backend
       has neither equations nor memory of an earlier run.
    2. It raises for a network that it cannot run; ``Run.status`` describes how a run ended.
    3. Time is network time, and states and residuals are those of the network, whatever the backend
       counts in.
    4. `kinds` are the preconditioner kinds that a network designed for the backend may have.
    5. A backend is a record. If its runs take long, it reports to its field ``progress``; if that
       call raises `Stopped`, the run ends and returns the results so far.
    """

    @property
    def kinds(self) -> tuple[PreconditionerKind, ...]:
        """Preconditioner kinds among which a design for this backend chooses by default."""
        ...

    def run(self, network: Network) -> Run:
        """Return the complete run, whatever its outcome."""
        ...


def reporting(backend: Backend, progress: Progress) -> Backend:
    """Return the backend with a receiver of progress, if it reports and has none."""
    if progress is silent or not _reports(backend):
        return backend
    record: Any = backend
    return replace(record, progress=progress) if record.progress is silent else backend


def _reports(backend: Backend) -> bool:
    return is_dataclass(backend) and "progress" in {field.name for field in fields(backend)}


def within(backend: Backend, deadline: Deadline) -> Backend:
    """Return the backend with a deadline that ends its runs.

    A backend that does not report progress is returned unchanged.
    """
    if not _reports(backend):
        return backend
    record: Any = backend

    def progress(line: str) -> None:
        deadline.check()
        record.progress(line)

    return replace(record, progress=progress)
