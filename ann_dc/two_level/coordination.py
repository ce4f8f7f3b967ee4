"""Solution of one problem by the two-level algorithm: design to certificate.

A network is designed for the corrected equations with closing B: q_0 is a neuron, so every stage
can be solved separately. The coordinator is chosen at its solution, and the iteration runs from the
usual initial guess to a small fraction of the tolerance, so that the result can be certified.
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
from ann_dc.network.preconditioners.base import PreconditionerKind
from ann_dc.optimality.certificate import Certificate, certify
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.progress import Progress, silent
from ann_dc.summaries import summarised
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
from ann_dc.validation import State, checked

ROUNDING = 1e-9
"""Relative increase of Theta that counts as rounding."""
ELSEWHERE = 1e-6
"""Fraction of the initial Theta above which a settled run has reached another solution."""
POLISHING = 3
"""Newton iterations from the designed point; the design is accurate to 1e-8, and Theta is more
sensitive.
"""

Coordinator: TypeAlias = Callable[[Network, np.ndarray], tuple[UpperLevel, UpperGains | None]]
"""Function that chooses an upper level at the solution (n,) of a network and returns its gains."""


@checked
def best_gradient(network: Network, settled: State) -> tuple[UpperLevel, UpperGains]:
    """Return the gradient upper level (17) with the smallest spectral radius.

    Raises `DesignError` if the lower level is singular at the solution ``settled`` (n,).
    """
    gains = UpperMap(network=network, settled=settled).best()
    return Gradient(lambda_t=gains.lambda_t, lambda_beta=gains.lambda_beta), gains


def newton(network: Network, settled: State) -> tuple[UpperLevel, None]:
    """Return the Newton upper level, which does not need the solution."""
    return NewtonCoordinator(), None


def half_bound(network: Network, settled: State) -> tuple[UpperLevel, None]:
    """Return the oracle upper level (33), corrected, with half of |B/A|.

    This gain decreases Theta most if B < 0.
    """
    return OracleCoordinator(gain=OracleGain(settled=settled, share=0.5)), None


COORDINATORS: dict[str, Coordinator] = {
    Gradient.name: best_gradient,
    NewtonCoordinator.name: newton,
    OracleCoordinator.name: half_bound,
}
"""Coordinators by name, for the command line."""


@checked
@summarised(
    lambda self: {
        "problem": self.problem.name,
        "coordinator": self.coordinator,
        "outcome": self.message,
        "certified": "yes" if self.certified else "no",
    }
)
@dataclass(frozen=True, kw_only=True, eq=False)
class Coordination:
    """Run of the two-level algorithm with its predictions and certificate.

    Attributes
    ----------
    coordinator, lower : str
        Names of the upper and the lower level.
    following, hypothesis : Following, Hypothesis
        Theorems IV.1 and IV.2 at the designed solution.
    gains : UpperGains or None
        Gains of the coordinator, None if it has no gains.
    run : TwoLevelRun
        Run of one sample, with Theta.
    tolerance : float
        Tolerance on the relative KKT residual for counting iterations. The tolerance of the run is
        a fraction of this value.
    values : dict of str to list
        States at N + 1 stages and controls at N stages by name, in the user's units.
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
        """Outcome of the run."""
        return self.run.outcomes[0]

    @property
    def message(self) -> str:
        """Description of the outcome in one sentence."""
        return self.run.message(0)

    @property
    def needed(self) -> int | None:
        """Outer iterations until the residual stays below the tolerance; None if never."""
        count = int(replace(self.run, tolerance=self.tolerance).outer_iterations[0])
        return None if count < 0 else count

    @property
    def predicted(self) -> float | None:
        """Prediction of `needed` from the gains; None without stable gains."""
        expected = np.inf if self.gains is None else self.gains.predicted(self.tolerance)
        return float(expected) if np.isfinite(expected) else None

    @property
    def theta(self) -> np.ndarray:
        """Theta (J + 1,) before every outer iteration and at the end."""
        lyapunov = self.run.lyapunov
        return np.array([]) if lyapunov is None else lyapunov.theta[:, 0]

    @property
    def rises(self) -> int:
        """Number of outer iterations in which Theta increased beyond rounding."""
        with np.errstate(all="ignore"):  # a run that diverged
            return int((~(self.theta[1:] <= self.theta[:-1] * (1 + ROUNDING))).sum())

    @property
    def elsewhere(self) -> bool:
        """True if the run settled to another solution than the design."""
        settled = self.outcome is Outcome.SETTLED
        return settled and bool(self.theta[-1] > ELSEWHERE * self.theta[0])

    @property
    def certified(self) -> bool:
        """True if the run settled to a certified optimum (first and second order)."""
        return self.outcome is Outcome.SETTLED and self.certificate.certified

    @property
    def verdict(self) -> str:
        """Reason why the final state is or is not certified."""
        if self.outcome is not Outcome.SETTLED:
            return "the two levels did not settle"
        return self.certificate.reason


@dataclass(frozen=True, kw_only=True, eq=False)
class Undesigned:
    """Result without a run: the design did not settle in a number of ``steps``.

    The theorem and the gains need the designed solution.
    """

    problem: OptimalControlProblem
    steps: int
    certified = False

    @property
    def message(self) -> str:
        """Description of the failure in one sentence."""
        return (
            f"{self.problem.name}: the design did not settle in {self.steps} steps, so Theorem "
            "IV.2 cannot be checked and gains cannot be chosen; check that the target is "
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
    """Solve a problem with the two-level algorithm and certify the result.

    Parameters
    ----------
    problem : OptimalControlProblem
        Problem to solve, without inequalities, bounds and objectives.
    coordinator : Coordinator
        One of `COORDINATORS`; the default is `best_gradient`.
    lower : LowerLevel, optional
        Lower level; the default is the one that suits the coordinator.
    settling : Settling, optional
        Settling criterion. Outer iterations are counted to its tolerance and continue to
        ``confirm`` times the tolerance.
    limit : int
        Largest number of outer iterations.
    progress : Progress
        Receives status messages, one line at a time.

    Returns
    -------
    Coordination or Undesigned
        `Undesigned` if the design found no solution.

    Raises
    ------
    ProblemError
        If the problem has inequalities, bounds or objectives.
    DesignError
        If the coordinator needs gains and the lower level is singular at the solution.

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
    # neither level has a preconditioner; the penalty of a grid makes the upper level slow
    designed = design(
        synthesize(equations), preconditioner=PreconditionerKind.MULTILEVEL, progress=progress
    )
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
    """Return the solution (n,) of a design, refined to machine precision."""
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
