"""Distinct optima of many initial guesses, separated by objective and controls.

Each optimum is certified. Gains derived from one optimum stabilise few distant ones. A guess that
the common network loses therefore gets a gain-scheduled run, as in a design.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace

import numpy as np

from ann_dc.backends.batch import BatchRun
from ann_dc.backends.status import Outcome
from ann_dc.evaluation.populations import kkt_point
from ann_dc.families.seeded_starts import LONGEST
from ann_dc.gain_design.gain_rule import MULTILEVEL_RULE
from ann_dc.gain_design.scheduled_run import first_run
from ann_dc.network.network import Network
from ann_dc.optimality.certificate import Certificate
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.progress import Progress
from ann_dc.solution.solution import certificate_of

SAME = 1e-3
"""Relative distance of objectives, and of every control, below which two optima are equal."""
TOLERANCE = 1e-10
"""KKT residual of a separate run, in network units."""
NAMES = {
    Outcome.SETTLED: "settled, but not certified",
    Outcome.NOT_SETTLED: "not settled within the steps given",
    Outcome.DIVERGED: "diverged",
    Outcome.LEFT_DOMAIN: "left the domain of a function",
    Outcome.STALLED: "stalled",
    Outcome.STOPPED: "stopped before their end",
}
"""Description of guesses without an optimum, by the outcome in the batch."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Optimum:
    """Certified optimum with the initial guesses that lead to it.

    Attributes
    ----------
    state : (n,) array
        Settled state from the first of its guesses, in network units.
    q : (n, N+1) array
        States with the terminal state, in the user's units.
    u : (m, N) array
        Controls.
    certificate : Certificate
        Certificate from the problem's derivatives.
    starts : tuple of int
        Indices of the guesses that lead to this optimum.
    frozen : int
        Number of these guesses, the first ones, for which the common network with fixed gains
        reached it. The others needed a gain-scheduled run.
    share : float
        Fraction of all guesses.
    """

    state: np.ndarray
    q: np.ndarray
    u: np.ndarray
    certificate: Certificate
    starts: tuple[int, ...]
    frozen: int
    share: float

    @property
    def objective(self) -> float:
        """Total cost E in the user's units."""
        return self.certificate.objective

    @property
    def count(self) -> int:
        """Number of initial guesses that lead to this optimum."""
        return len(self.starts)


def sorted_out(
    problem: OptimalControlProblem,
    batch: BatchRun,
    starts: np.ndarray | None,
    progress: Progress,
) -> tuple[tuple[Optimum, ...], dict[str, int]]:
    """Return the distinct optima of a batch, and the number of guesses without one.

    The batch is that of one network with fixed gains from all guesses. Guesses that the batch lost
    get a separate run from `starts` (B, n); None omits these runs. Optima are sorted best first.
    Guesses without an optimum are counted by their outcome in the batch. `progress` receives one
    line per run.
    """
    found: list[Optimum] = []
    others: Counter[str] = Counter()
    lost = [
        sample
        for sample in range(len(batch))
        if not (batch.settled[sample] and _entered(found, problem, batch, sample))
    ]
    for number, sample in enumerate(lost, 1):
        progress(f"start {sample}: a run of its own, {number} of {len(lost)}")
        own = None if starts is None else _own_run(batch.network.with_start(starts[sample]))
        if own is None or not _entered(found, problem, batch, sample, own):
            others[NAMES[batch.outcomes[sample]]] += 1
    shared = [replace(optimum, share=optimum.count / len(batch)) for optimum in found]
    return tuple(sorted(shared, key=lambda optimum: optimum.objective)), dict(others.most_common())


def _own_run(network: Network) -> np.ndarray | None:
    """Return the settled state of a gain-scheduled run from the network's start."""
    with np.errstate(all="ignore"):  # a run that overflows is data
        run = first_run(network, MULTILEVEL_RULE, tolerance=TOLERANCE, limit=LONGEST)
    return run.state if run.settled else None


def _entered(
    found: list[Optimum],
    problem: OptimalControlProblem,
    batch: BatchRun,
    sample: int,
    state: np.ndarray | None = None,
) -> bool:
    """Return True if a state (default: that of the batch) is an optimum, and count it."""
    x, frozen = (batch.states[sample], 1) if state is None else (state, 0)
    certificate = certificate_of(problem, batch.network, x)
    if not certificate.certified:
        return False
    q, u, t, *_ = kkt_point(batch.network, x)
    for place, known in enumerate(found):
        if _same(known, certificate.objective, u):
            starts = (*known.starts, sample)
            found[place] = replace(known, starts=starts, frozen=known.frozen + frozen)
            return True
    optimum = Optimum(
        state=x, q=np.c_[q, t[:, -1:]], u=u, certificate=certificate, starts=(sample,),
        frozen=frozen,
        share=0.0,
    )  # fmt: skip
    found.append(optimum)
    return True


def _same(known: Optimum, objective: float, u: np.ndarray) -> bool:
    """Return True if an optimum equals a known one in objective and in every control."""
    if abs(objective - known.objective) > SAME * max(abs(objective), abs(known.objective)):
        return False
    size = np.maximum(np.abs(u), np.abs(known.u)).max(axis=1)
    return bool((np.abs(u - known.u).max(axis=1) <= SAME * size).all())
