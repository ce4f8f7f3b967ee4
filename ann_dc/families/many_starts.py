"""Multistart: the optima of one problem from many initial guesses.

A network with fixed gains settles at an optimum near its initial guess, and a problem may have
several optima. One design serves all guesses: the network is the same, and recurrent steps process
all guesses together. Gains derived from one optimum stabilise few distant ones, so a guess that
this network loses gets a gain-scheduled run, as in a design. All settled points are certified from
the problem alone and separated by objective and controls.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np

from ann_dc.backends.batch import BatchRun
from ann_dc.backends.recurrent.backend import RecurrentBackend
from ann_dc.backends.status import Outcome
from ann_dc.backends.step_rules import TWO_PHASE
from ann_dc.decomposition.equations import StageEquations, decompose
from ann_dc.evaluation.populations import kkt_point
from ann_dc.families.seeded_starts import LONGEST, checked_starts, seeded_starts
from ann_dc.gain_design import procedure
from ann_dc.gain_design.gain_rule import MULTILEVEL_RULE
from ann_dc.gain_design.knowledge import NOTHING
from ann_dc.gain_design.procedure import Design
from ann_dc.gain_design.scheduled_run import first_run
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.base import Kinds, PreconditionerKind
from ann_dc.optimality.certificate import Certificate
from ann_dc.optimality.existence import Prospect
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.problem.initial_guess import InitialGuess
from ann_dc.progress import Progress, silent
from ann_dc.si_prefixes import counted
from ann_dc.solution.knowledge import knowledge_of
from ann_dc.solution.solution import Solution, certificate_of
from ann_dc.summaries import summarised
from ann_dc.synthesis.row import start_values
from ann_dc.synthesis.synthesis import synthesize
from ann_dc.validation import NotEmpty, Own, checked

SAME = 1e-3
"""Relative distance of objectives, and of every control, below which two optima are equal."""
TOLERANCE = 1e-10
"""KKT residual of a separate run, in network units."""
NAMES = {
    Outcome.SETTLED: "settled, but not certified",
    Outcome.COMPLETED: "not settled at the end of the given duration",
    Outcome.NOT_SETTLED: "not settled within the given steps",
    Outcome.DIVERGED: "diverged",
    Outcome.LEFT_DOMAIN: "left the domain of a function",
    Outcome.STALLED: "stalled",
    Outcome.STOPPED: "stopped before their end",
}
"""Description of guesses without an optimum, by the outcome in the batch."""
NEAR_ONE_OPTIMUM = (PreconditionerKind.RESISTIVE_GRID, PreconditionerKind.CYCLIC_REDUCTION)
"""Preconditioner kinds derived from the optimum of the design, at which few others are stable."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Optimum:
    """Certified optimum with the initial guesses that lead to it.

    `state` (n,) is the settled state from the first of them, in network units. States `q` (n, N+1)
    and controls `u` (m, N) are in the user's units. `starts` contains the indices of the guesses,
    and `share` is their fraction of all guesses. The first `frozen` guesses settled in the common
    network with fixed gains; the others needed a gain-scheduled run.
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


@checked
@summarised(
    lambda self: {
        "problem": self.problem.name,
        "initial guesses": len(self.starts),
        "optima": len(self.optima),
        "not settled": self.unsettled,
    }
)
@dataclass(frozen=True, kw_only=True, eq=False)
class Multistart:
    """Optima of a network from many initial guesses.

    Attributes
    ----------
    problem : OptimalControlProblem
        Solved problem.
    equations : StageEquations
        Wired equations.
    design : Design
        Design of the one network that ran from all guesses.
    starts : tuple of InitialGuess
        Initial guesses.
    backend : RecurrentBackend
        Backend of the batch.
    batch : BatchRun
        End of the run from every guess.
    optima : tuple of Optimum
        Distinct certified optima, best first.
    others : dict of str to int
        Number of guesses without an optimum, by reason.

    Examples
    --------
    >>> from ann_dc import multistart, plants
    >>> found = multistart(plants.double_integrator(N=5), 4)
    >>> print(found)
    double_integrator (N = 5): 1 certified optimum from 4 starts
      objective  starts   share      with fixed gains
            500       4    100%                      4
    """

    problem: OptimalControlProblem
    equations: StageEquations
    design: Design
    starts: Annotated[tuple[InitialGuess, ...], NotEmpty()]
    backend: RecurrentBackend
    batch: BatchRun
    optima: tuple[Optimum, ...]
    others: dict[str, int]

    def __len__(self) -> int:
        return len(self.optima)

    @property
    def best(self) -> Optimum | None:
        """Optimum with the lowest objective; None if nothing was certified."""
        return self.optima[0] if self.optima else None

    @property
    def unsettled(self) -> int:
        """Number of initial guesses without a certified optimum."""
        return sum(self.others.values())

    @checked
    def solution(self, index: int = 0) -> Solution:
        """Return the solution of a single run from the first guess of an optimum.

        The solution has its trajectory. A sample is bit-identical alone and in a batch, so that the
        run settles at this optimum again. An optimum at which the common network does not settle
        gets a separate design from its first guess. If nothing was certified, the run is from the
        first guess of all.

        Parameters
        ----------
        index : int
            Index in ``optima``. Default 0.
        """
        start = self.optima[index].starts[0] if self.optima else 0
        network = self.batch.network
        network = network.with_start(start_values(network, self.starts[start]))
        if not self.optima or self.optima[index].frozen:
            return self._ran(network, self.design)
        known = knowledge_of(Prospect(problem=self.problem), network)
        known = known._replace(finder=NOTHING.finder)  # it could lead to another optimum
        designed = procedure.design(network, preconditioner=self.backend.kinds, knowledge=known)
        solution = self._ran(designed.network, designed)
        for other in designed.alternatives():
            if np.isclose(solution.objective, self.optima[index].objective, rtol=SAME):
                break
            solution = self._ran(other.network, other)
        return solution

    def _ran(self, network: Network, designed: Design) -> Solution:
        """Run a network with fixed gains and certify its final state."""
        run = self.backend.run(network)
        return Solution(
            problem=self.problem,
            equations=self.equations,
            network=network,
            run=run,
            certificate=certificate_of(self.problem, network, run.trajectory.final),
            design=designed,
        )

    def as_dict(self) -> dict:
        """Return plain data for JSON."""
        states, controls = [*map(str, self.problem.states)], [*map(str, self.problem.controls)]
        return {
            "problem": self.problem.name,
            "starts": len(self.starts),
            "optima": [
                {
                    "objective": optimum.objective,
                    "starts": list(optimum.starts),
                    "frozen": optimum.frozen,
                    "share": optimum.share,
                    "kkt_residual": optimum.certificate.kkt_residual,
                    "newton_step": optimum.certificate.newton_step,
                    "rollout_error": optimum.certificate.rollout_error,
                    "states": dict(zip(states, optimum.q.tolist())),
                    "controls": dict(zip(controls, optimum.u.tolist())),
                }
                for optimum in self.optima
            ],
            "others": self.others,
        }

    def __str__(self) -> str:
        optima = "optimum" if len(self) == 1 else "optima"
        lines = [
            f"{self.problem.name} (N = {self.problem.horizon}): {len(self) or 'no'} certified "
            f"{optima} from {counted(len(self.starts), 'starts')}"
        ]
        lines += ["  objective  starts   share      with fixed gains"] if self.optima else []
        lines += [
            f"{o.objective:11.6g} {o.count:7d} {o.share:7.0%} {o.frozen:22d}" for o in self.optima
        ]
        lines += [f"  {count} {what}" for what, count in self.others.items()]
        if not self.optima and self.design.first.ended is not None:
            lines.append(f"  {self.design.first.ended}")
        return "\n".join(lines)


@checked
def multistart(
    problem: OptimalControlProblem,
    starts: Annotated[int | Sequence[InitialGuess], Own()] = 64,
    *,
    seed: Annotated[int, Own()] = 0,
    preconditioner: Annotated[Kinds, NotEmpty()] | None = None,
    backend: RecurrentBackend | None = None,
    progress: Progress = silent,
) -> Multistart:
    """Find the optima at which one network settles from many guesses, best first.

    Parameters
    ----------
    problem : OptimalControlProblem
        Problem to solve.
    starts : int or sequence of InitialGuess
        Number of guesses to generate (`seeded_starts`), or the guesses. The network is designed
        from the first. Default 64.
    seed : int
        Seed of the generated guesses. Default 0.
    preconditioner : PreconditionerKind, str, or iterable of these, optional
        Preconditioner kinds from which the design chooses. Default: those that suit the backend,
        without those derived from one optimum (`NEAR_ONE_OPTIMUM`).
    backend : RecurrentBackend, optional
        Backend of the runs. Default: two phases, at most `LONGEST` steps.
    progress : Progress
        Receives one line per step. Default: silent.

    Returns
    -------
    Multistart
        Returned for every outcome; the same seed gives the same numbers.

    Raises
    ------
    ProblemError
        If a count, a seed or a guess is invalid, or the network cannot start there.
    DesignError
        If numbers of the design overflow.

    Examples
    --------
    >>> from ann_dc import plants
    >>> found = multistart(plants.double_integrator(N=5), 4)
    >>> round(found.best.objective, 3), found.best.count
    (500.0, 4)
    """
    listed = isinstance(starts, Sequence) and not isinstance(starts, str)
    made = checked_starts(problem, starts) if listed else seeded_starts(problem, starts, seed=seed)  # pyright: ignore[reportArgumentType]
    backend = replace(
        backend or RecurrentBackend(order=TWO_PHASE, limit=LONGEST), progress=progress
    )
    if preconditioner is None:
        preconditioner = tuple(kind for kind in backend.kinds if kind not in NEAR_ONE_OPTIMUM)
    equations = decompose(problem)
    first = synthesize(equations, initial_guess=made[0])
    designed = procedure.design(
        first,
        preconditioner=preconditioner,
        progress=progress,
        knowledge=knowledge_of(Prospect(problem=problem, progress=progress), first),
    )
    network = designed.network
    x = np.stack([start_values(network, start) for start in made])
    batch = backend.run_batch(network, {}, x)
    progress(f"certification: {int(batch.settled.sum())} of {len(made)} starts settled")
    hopeful = designed.first.ended is None
    optima, others = _sorted_out(problem, batch, x if hopeful else None, progress)
    return Multistart(
        problem=problem,
        equations=equations,
        design=designed,
        starts=tuple(made),
        backend=replace(backend, progress=silent),
        batch=batch,
        optima=optima,
        others=others,
    )


def _sorted_out(
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
        if not (batch.settled[sample] and _is_entered(found, problem, batch, sample))
    ]
    for number, sample in enumerate(lost, 1):
        progress(f"start {sample}: separate run, {number} of {len(lost)}")
        own = None if starts is None else _own_run(batch.network.with_start(starts[sample]))
        if own is None or not _is_entered(found, problem, batch, sample, own):
            others[NAMES[batch.outcomes[sample]]] += 1
    shared = [replace(optimum, share=optimum.count / len(batch)) for optimum in found]
    return tuple(sorted(shared, key=lambda optimum: optimum.objective)), dict(others.most_common())


def _own_run(network: Network) -> np.ndarray | None:
    """Return the settled state of a gain-scheduled run from the network's start."""
    with np.errstate(all="ignore"):  # a run that overflows is data
        run = first_run(network, MULTILEVEL_RULE, tolerance=TOLERANCE, limit=LONGEST)
    return run.state if run.settled else None


def _is_entered(
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
        state=x,
        q=np.c_[q, t[:, -1:]],
        u=u,
        certificate=certificate,
        starts=(sample,),
        frozen=frozen,
        share=0.0,
    )
    found.append(optimum)
    return True


def _same(known: Optimum, objective: float, u: np.ndarray) -> bool:
    """Return True if an optimum equals a known one in objective and in every control."""
    if abs(objective - known.objective) > SAME * max(abs(objective), abs(known.objective)):
        return False
    size = np.maximum(np.abs(u), np.abs(known.u)).max(axis=1)
    return bool((np.abs(u - known.u).max(axis=1) <= SAME * size).all())
