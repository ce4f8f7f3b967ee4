"""One problem by the two-level algorithm: designed, predicted, run, certified.

A network is designed for the corrected equations, closing B: with q_0 as a neuron every stage can
be solved by itself. At its solution Theorem IV.2 is checked and the coordinator chosen; then the
iteration runs from the usual start. It goes on to a small share of the tolerance, as every run
does, so that its end can be certified.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from ann_dc.backends.settling import Settling
from ann_dc.backends.status import Outcome
from ann_dc.decomposition.equations import decompose
from ann_dc.decomposition.form import Form
from ann_dc.evaluation.populations import kkt_point, neuron_values
from ann_dc.gain_design.procedure import Design, design
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.base import Kind
from ann_dc.optimality.certificate import Certificate, certify
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.progress import Progress, silent
from ann_dc.synthesis.synthesis import synthesize
from ann_dc.two_level.levels import TwoLevels
from ann_dc.two_level.lower_level import LowerLevel
from ann_dc.two_level.oracle_gain import OracleGain
from ann_dc.two_level.run import TwoLevelRun
from ann_dc.two_level.sample import check_problem
from ann_dc.two_level.theorem import Following, Hypothesis, theorem_IV_1, theorem_IV_2
from ann_dc.two_level.upper_gains import UpperGains, UpperMap
from ann_dc.two_level.upper_level import (
    Gradient,
    NewtonCoordinator,
    OracleCoordinator,
    UpperLevel,
)
from ann_dc.validation.checked import checked
from ann_dc.validation.values import State

ROUNDING = 1e-9
"""A rise of Theta below this share of it is none."""
ELSEWHERE = 1e-6
"""A run that settles with more than this share of its first Theta settled to another solution."""
POLISHING = 3
"""Newton iterations from the designed point, which is good to 1e-8: Theta can tell more."""

Coordinator: TypeAlias = Callable[[Network, np.ndarray], tuple[UpperLevel, UpperGains | None]]
"""Chooses an upper level at the solution (n,) of a network, and says which gains it has."""


@checked
def best_gradient(network: Network, settled: State) -> tuple[UpperLevel, UpperGains]:
    """(17) with the gains whose spectral radius at the solution is smallest.

    Parameters
    ----------
    network : Network
        In which every stage can be solved by itself: closing B.
    settled : (n,) array
        Its solution, in network units.

    Returns
    -------
    upper : Gradient
        With these gains.
    gains : UpperGains
        And their spectral radius.

    Raises
    ------
    DesignError
        If the lower level is singular at the solution.

    Examples
    --------
    >>> import ann_dc
    >>> problem = ann_dc.plants.double_integrator(N=5)
    >>> equations = ann_dc.decompose(problem, ann_dc.Form(start_is_neuron=True))
    >>> designed = ann_dc.design(ann_dc.synthesize(equations))
    >>> upper, gains = best_gradient(designed.network, designed.state)
    >>> gains.radius < 1
    True
    """
    gains = UpperMap(network=network, settled=settled).best()
    return Gradient(lambda_t=gains.lambda_t, lambda_beta=gains.lambda_beta), gains


@checked
def newton(network: Network, settled: State) -> tuple[UpperLevel, None]:
    """A banded linear system in every outer iteration; it needs no solution.

    Parameters
    ----------
    network : Network
    settled : (n,) array
        Not looked at.
    """
    return NewtonCoordinator(), None


def half_bound(network: Network, settled: State) -> tuple[UpperLevel, None]:
    """(33) with half of |B/A|, which lowers Theta most where B < 0.

    Parameters
    ----------
    network : Network
    settled : (n,) array
        Its solution, in network units.

    References
    ----------
    Paper equation (33), corrected.
    """
    return OracleCoordinator(gain=OracleGain(settled=settled, share=0.5)), None


COORDINATORS: dict[str, Coordinator] = {
    Gradient.name: best_gradient,
    NewtonCoordinator.name: newton,
    OracleCoordinator.name: half_bound,
}
"""Every coordinator by its name, for the command line."""


@checked
@dataclass(frozen=True, kw_only=True, eq=False)
class Coordination:
    """A run of the two-level algorithm, and what was known before it.

    Attributes
    ----------
    problem : OptimalControlProblem
        What was solved.
    coordinator, lower : str
        Names of the two levels.
    following : Following
        The rate of Theorem IV.1, at the designed solution.
    hypothesis : Hypothesis
        Of Theorem IV.2, there too.
    gains : UpperGains or None
        Of a coordinator that has them.
    run : TwoLevelRun
        Of one sample, with Theta.
    tolerance : float
        On the KKT residual, for counting; the run's own is a share of it.
    certificate : Certificate
        Of its last state.
    values : dict of str to list
        States over N + 1 stages and controls over N, by name, in the user's units.

    Examples
    --------
    >>> from ann_dc import plants
    >>> found = coordinate(plants.double_integrator(N=5), coordinator=newton)
    >>> found.outcome.name, found.needed, found.rises
    ('SETTLED', 4, 0)
    >>> [round(a) for a in found.values["a"]]  # controls, in the user's units
    [20, 10, 0, -10, -20]
    """

    problem: OptimalControlProblem
    coordinator: str
    lower: str
    following: Following
    hypothesis: Hypothesis
    gains: UpperGains | None
    run: TwoLevelRun
    tolerance: float
    certificate: Certificate
    values: dict[str, list[float]]

    @property
    def outcome(self) -> Outcome:
        """How the run ended."""
        return self.run.outcomes[0]

    @property
    def message(self) -> str:
        """How the run ended, in a sentence."""
        return self.run.message(0)

    @property
    def needed(self) -> int | None:
        """Outer iterations after which the residual stays below the tolerance; None if never."""
        count = int(replace(self.run, tolerance=self.tolerance).outer_iterations[0])
        return None if count < 0 else count

    @property
    def predicted(self) -> float | None:
        """What the gains let expect of `needed`; None without gains, or where they repel."""
        expected = np.inf if self.gains is None else self.gains.predicted(self.tolerance)
        return float(expected) if np.isfinite(expected) else None

    @property
    def theta(self) -> np.ndarray:
        """(J + 1,) Theta before every outer iteration, and at the end."""
        lyapunov = self.run.lyapunov
        return np.array([]) if lyapunov is None else lyapunov.theta[:, 0]

    @property
    def rises(self) -> int:
        """Outer iterations in which Theta did not fall."""
        with np.errstate(all="ignore"):  # a run that diverged
            return int((~(self.theta[1:] <= self.theta[:-1] * (1 + ROUNDING))).sum())

    @property
    def elsewhere(self) -> bool:
        """Whether it settled to another solution than the design's."""
        settled = self.outcome is Outcome.SETTLED
        return settled and bool(self.theta[-1] > ELSEWHERE * self.theta[0])

    @property
    def certified(self) -> bool:
        """Whether the run settled to an optimum, of both orders."""
        return self.outcome is Outcome.SETTLED and self.certificate.certified

    @property
    def verdict(self) -> str:
        """Why the end point is certified, or why not."""
        if self.outcome is not Outcome.SETTLED:
            return "the two levels did not settle"
        return self.certificate.reason


@checked
@dataclass(frozen=True, kw_only=True, eq=False)
class Undesigned:
    """No run: the design found no solution, at which the theorem and the gains are looked at.

    Attributes
    ----------
    problem : OptimalControlProblem
        What was to be solved.
    steps : int
        How long the design looked.
    """

    problem: OptimalControlProblem
    steps: int
    certified = False

    @property
    def message(self) -> str:
        """What is missing, in a sentence."""
        return (
            f"{self.problem.name}: the design did not settle in {self.steps} steps, so there is no "
            "solution at which to check Theorem IV.2 and to choose gains; check that the target is "
            "within reach"
        )


@checked
def coordinate(
    problem: OptimalControlProblem,
    *,
    coordinator: Coordinator = best_gradient,
    lower: LowerLevel | None = None,
    settling: Settling | None = None,
    limit: int = 2000,
    progress: Progress = silent,
) -> Coordination | Undesigned:
    """Solve a problem by the paper's two-level algorithm, and certify what it says.

    Parameters
    ----------
    problem : OptimalControlProblem
        What to solve.
    coordinator : Coordinator
        One of `COORDINATORS`.
    lower : LowerLevel, optional
        By default the one that suits the coordinator.
    settling : Settling, optional
        Outer iterations are counted to its tolerance, and go on to ``confirm`` of it.
    limit : int
        Largest number of outer iterations.
    progress : Progress
        Told one line at a time what is going on.

    Returns
    -------
    Coordination or Undesigned
        The latter where the design found no solution.

    Raises
    ------
    ProblemError
        If the problem has inequalities or bounds.
    DesignError
        If a coordinator looks for gains and the lower level is singular at the solution.

    Examples
    --------
    >>> from ann_dc import plants
    >>> found = coordinate(plants.double_integrator(N=5), coordinator=newton)
    >>> found.certified, found.needed
    (True, 4)

    References
    ----------
    Paper section IV.A, equations (16), (17), (33), and Theorem IV.2, corrected.
    """
    check_problem(problem)
    settling = settling or Settling()
    equations = decompose(problem, Form(start_is_neuron=True))
    # neither level has a metric, and the penalty that suits a grid makes the upper level slow
    designed = design(synthesize(equations), kinds=[Kind.PYRAMID], progress=progress)
    if not designed.settled:
        return Undesigned(problem=problem, steps=designed.first.steps)
    network, settled = designed.network, polished(designed)
    progress("choosing lambda_t and lambda_beta")
    upper, gains = coordinator(network, settled)
    layer = TwoLevels(network, upper=upper, lower=lower)
    tolerance = settling.confirm * settling.tolerance
    run = layer.run(settled=settled, tolerance=tolerance, limit=limit, progress=progress)
    return Coordination(
        problem=problem,
        coordinator=upper.name,
        lower=layer.lower.name,
        following=theorem_IV_1(network, settled),
        hypothesis=theorem_IV_2(network, settled),
        gains=gains,
        run=run,
        tolerance=settling.tolerance,
        certificate=certify(problem, *kkt_point(network, run.states[0])),
        values=_values(problem, network, run.states[0]),
    )


def polished(designed: Design) -> np.ndarray:
    """The solution (n,) of a design, as exactly as the arithmetic has it."""
    layer = TwoLevels(designed.network, upper=NewtonCoordinator())
    run = layer.run(designed.state, tolerance=0.0, limit=POLISHING)
    better = run.residuals[-1, 0] < run.residuals[0, 0]
    return run.states[0] if better else designed.state


def _values(
    problem: OptimalControlProblem, network: Network, x: np.ndarray
) -> dict[str, list[float]]:
    values = neuron_values(network, x)
    q = np.vstack([values["q"], values["t"][-1:]])
    columns = [*zip(problem.states, q.T), *zip(problem.controls, values["u"].T)]
    return {str(symbol): column.tolist() for symbol, column in columns}
