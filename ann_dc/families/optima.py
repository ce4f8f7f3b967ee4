"""Optima that many starts led to: told apart by objective and controls, certified one by one.

Constants that were read off one optimum hold few of the others where these lie far apart, so that
a start which a frozen network loses has a run of its own, with gains that are recomputed on the way
as in a design.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace

import numpy as np

from ann_dc.backends.batch import BatchRun
from ann_dc.backends.status import Outcome
from ann_dc.evaluation.populations import kkt_point
from ann_dc.families.seeded_starts import LONGEST
from ann_dc.gain_design.gain_rule import WITH_COORDINATORS
from ann_dc.gain_design.scheduled_run import first_run
from ann_dc.network.network import Network
from ann_dc.optimality.certificate import Certificate
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.progress import Progress
from ann_dc.solution.solution import certificate_of

SAME = 1e-3
"""Relative distance of objectives, and of every control, below which two optima are one."""
TOLERANCE = 1e-10
"""KKT residual of a run of a start's own, in network units."""
NAMES = {
    Outcome.SETTLED: "settled, but not certified",
    Outcome.NOT_SETTLED: "not settled within the steps given",
    Outcome.DIVERGED: "diverged",
    Outcome.LEFT_DOMAIN: "left the domain of a function",
    Outcome.STALLED: "stalled",
    Outcome.STOPPED: "stopped before their end",
}
"""What became of the starts that led to no optimum: all that a batch says of a sample."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Optimum:
    """A certified optimum, and the starts that led to it.

    Attributes
    ----------
    state : (n,) array
        Where the network settled from the first of its starts, in network units.
    q : (n, N+1) array
        States with the end, in the user's units.
    u : (m, N) array
        Controls.
    certificate : Certificate
        By the problem's own derivatives.
    starts : tuple of int
        Which of the starts led here.
    frozen : int
        From how many of them the one frozen network did, the first ones; from the others a run with
        gains that were recomputed on the way.
    share : float
        Of all starts.
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
        """How many starts led here."""
        return len(self.starts)


def sorted_out(
    problem: OptimalControlProblem,
    batch: BatchRun,
    starts: np.ndarray | None,
    progress: Progress,
) -> tuple[tuple[Optimum, ...], dict[str, int]]:
    """The distinct optima of a batch, and how many starts led to none.

    Parameters
    ----------
    problem : OptimalControlProblem
    batch : BatchRun
        Of one frozen network, from all starts.
    starts : (B, n) array or None
        The starts, from which those that the batch lost get a run of their own; None where nothing
        could be found.
    progress : Progress
        Takes one line a run.

    Returns
    -------
    optima : tuple of Optimum
        Best first.
    others : dict of str to int
        Starts that led to none, by what became of them in the batch.
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
    """Where a network settles from its start with gains that are recomputed on the way."""
    with np.errstate(all="ignore"):  # a run that overflows is data
        run = first_run(network, WITH_COORDINATORS, tolerance=TOLERANCE, limit=LONGEST)
    return run.state if run.settled else None


def _entered(
    found: list[Optimum],
    problem: OptimalControlProblem,
    batch: BatchRun,
    sample: int,
    state: np.ndarray | None = None,
) -> bool:
    """Whether a start's state (that of the batch by default) is an optimum; it is counted then."""
    x, frozen = (batch.states[sample], 1) if state is None else (state, 0)
    proof = certificate_of(problem, batch.network, x)
    if not proof.certified:
        return False
    q, u, t, *_ = kkt_point(batch.network, x)
    for place, known in enumerate(found):
        if _same(known, proof.objective, u):
            starts = (*known.starts, sample)
            found[place] = replace(known, starts=starts, frozen=known.frozen + frozen)
            return True
    optimum = Optimum(
        state=x, q=np.c_[q, t[:, -1:]], u=u, certificate=proof, starts=(sample,), frozen=frozen,
        share=0.0,
    )  # fmt: skip
    found.append(optimum)
    return True


def _same(known: Optimum, objective: float, u: np.ndarray) -> bool:
    """Whether an optimum is the known one: by its objective, and by every control's range."""
    if abs(objective - known.objective) > SAME * max(abs(objective), abs(known.objective)):
        return False
    size = np.maximum(np.abs(u), np.abs(known.u)).max(axis=1)
    return bool((np.abs(u - known.u).max(axis=1) <= SAME * size).all())
