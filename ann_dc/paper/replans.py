"""Two-level iterations of Figure 6: lambda, A and B of every plan, and as printed.

When an obstacle is detected, IV.C plans again from q_obs + delta to the same target. The obstacle
itself is in no equation: a plan is the example with another q_0. A case is therefore the list of
its initial states. The paper gives no positions. Here obstacles lie on nodes of T_0, the plan
without obstacles, and delta = (-0.3, 0.3, 0, 0) passes on the outer side of the bend.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ann_dc.decomposition.equations import decompose
from ann_dc.decomposition.form import LowerForm, switch
from ann_dc.evaluation.populations import neuron_values
from ann_dc.gain_design.gains import apply_gains, manual_gains
from ann_dc.gain_design.procedure import Design, design
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.base import PreconditionerKind
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.problem.plants import car
from ann_dc.progress import Progress, silent
from ann_dc.synthesis.synthesis import synthesize
from ann_dc.two_level.coordination import best_gradient, polished
from ann_dc.two_level.levels import TwoLevels
from ann_dc.two_level.oracle_gain import OracleGain
from ann_dc.two_level.run import TwoLevelRun
from ann_dc.two_level.theorem import (
    Following,
    Hypothesis,
    PrintedMatrices,
    theorem_IV_1,
    theorem_IV_2,
)
from ann_dc.two_level.upper_gains import UpperMap
from ann_dc.two_level.upper_level import Gradient, NewtonCoordinator, OracleCoordinator

SHARE = 0.5
"""lambda as a fraction of |B/A|; for B < 0 one half decreases Theta most."""
ROUNDS = 20
"""Outer iterations shown for every plan."""
FIXED_ROUNDS = 80
"""Outer iterations with one fixed gain, which demonstrate (21)."""
NEWTON_ROUNDS = 25
TRIED = np.geomspace(1e-3, 10.0, 41)
NEAR = 0.1
"""Start of the one-gain run, as a fraction of the way from the solution to the interpolated guess.
Farther off, stages settle to other equilibria.
"""


@dataclass(frozen=True, kw_only=True)
class Case:
    """Obstacles that appear one after another, on nodes `stages` of T_0.

    `delta` is the offset from an obstacle to the new initial state, one number per state.
    """

    name: str
    stages: tuple[int, ...]
    delta: tuple[float, ...] = (-0.3, 0.3, 0.0, 0.0)

    def starts(self, plan: np.ndarray) -> np.ndarray:
        """Return q_0 of every plan T_0, T_1, ... (M + 1, n) from states (n, N + 1) of T_0.

        Examples
        --------
        >>> Case(name="one", stages=(1,), delta=(0.5,)).starts(np.array([[0.0, 2.0, 3.0]]))
        array([[0. ],
               [2.5]])
        """
        return np.vstack([plan[:, 0], plan[:, list(self.stages)].T + self.delta])


CASES = (
    Case(name="(a) four obstacles", stages=(2, 4, 5, 7)),
    Case(name="(b) three obstacles", stages=(3, 6, 7)),
)
"""Cases of Figure 6."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Plans:
    """Plans of a case: q_0 (M + 1, n), and one sample per plan of a `run` with lambda of (33).

    The Newton coordinator of `newton` computes the solutions that (33) requires: `states`
    (M + 1, n, N + 1) and `controls` (M + 1, m, N). All are in user units.
    """

    case: Case
    starts: np.ndarray
    run: TwoLevelRun
    newton: TwoLevelRun
    states: np.ndarray
    controls: np.ndarray


@dataclass(frozen=True, kw_only=True, eq=False)
class Iterations:
    """Results on the two-level algorithm.

    `letter` is (28)-(30) as printed with (33), for T_0. T_0 with two fixed gains (`gradient`) and
    with Newton's method settles. `common` starts near the solution with one fixed gain for t and
    beta, the subject of (21). `following` is the rate of Theorem IV.1. The hypotheses are those of
    Theorem IV.2 with the valid matrices, and with diag(0.99, 0.1) as printed.
    """

    cases: tuple[Plans, ...]
    letter: TwoLevelRun
    gradient: TwoLevelRun
    newton: TwoLevelRun
    common: TwoLevelRun
    following: Following
    hypothesis: Hypothesis
    printed_hypothesis: Hypothesis


def iterations(
    problem: OptimalControlProblem | None = None, progress: Progress = silent
) -> Iterations:
    """Run every case of Figure 6, by default with the paper's car, and evaluate both theorems.

    Examples
    --------
    >>> found = iterations()  # doctest: +SKIP
    >>> found.hypothesis.holds, found.printed_hypothesis.holds  # doctest: +SKIP
    (False, True)
    """
    problem = problem or car()
    progress("two levels: designing")
    equations = decompose(problem, switch("S14"))
    designed = design(synthesize(equations), preconditioner=PreconditionerKind.MULTILEVEL)
    network, settled = designed.network, polished(designed)
    two, one = best_gradient(network, settled)[0], one_gain(network, settled)
    line = network.start_state
    cases = []
    for case in CASES:
        progress(f"two levels: {case.name}")
        cases.append(replanned(designed, problem, case))
    progress("two levels: fixed gains")
    gradient, newton = (
        TwoLevels(network, upper=upper).run(settled=settled) for upper in (two, NewtonCoordinator())
    )
    common = TwoLevels(network, upper=one).run(
        settled + NEAR * (line - settled), settled=settled, limit=FIXED_ROUNDS
    )
    return Iterations(
        cases=tuple(cases),
        letter=to_the_letter(problem, settled),
        gradient=gradient,
        newton=newton,
        common=common,
        following=theorem_IV_1(network, settled),
        hypothesis=theorem_IV_2(network, settled),
        printed_hypothesis=theorem_IV_2(network, settled, matrices=PrintedMatrices()),
    )


def one_gain(network: Network, settled: np.ndarray) -> Gradient:
    """Return (17) with lambda_t = lambda_beta as in (20), the best of a few gains.

    The gain is selected by the spectral radius at the solution (n,).
    """
    upper = UpperMap(network=network, settled=settled)
    gain = float(min(TRIED, key=lambda gain: upper.radius(gain, gain)))
    return Gradient(lambda_t=gain, lambda_beta=gain)


def replanned(designed: Design, problem: OptimalControlProblem, case: Case) -> Plans:
    """Compute all plans of a case in one batch with one network of fixed gains.

    The design has q_0 as a neuron.
    """
    network = designed.network
    starts = case.starts(_plan(network, designed.state))
    inputs = {f"q_0.{s}": values for s, values in zip(problem.states, starts.T)}
    newton = TwoLevels(network, upper=NewtonCoordinator()).run(
        designed.state, inputs, tolerance=0.0, limit=NEWTON_ROUNDS
    )
    oracle = OracleCoordinator(gain=OracleGain(settled=newton.states, share=SHARE))
    run = TwoLevels(network, upper=oracle).run(inputs=inputs, settled=newton.states, limit=ROUNDS)
    return Plans(
        case=case,
        starts=starts,
        run=run,
        newton=newton,
        states=np.stack([_plan(network, x) for x in newton.states]),
        controls=np.stack([neuron_values(network, x)["u"].T for x in newton.states]),
    )


def to_the_letter(problem: OptimalControlProblem, settled: np.ndarray) -> TwoLevelRun:
    """Run (28)-(30) as printed on the plain Lagrangian with lambda = |B/A| of (33).

    `settled` (n,) is the solution of the corrected network with q_0 as a neuron, in network units.
    """
    form = replace(
        switch("S14"), lower_level=LowerForm.LITERAL, coupling_adds=True, coupling_reads_next=True
    )
    network = synthesize(decompose(problem, form), rho=0.0)
    network = apply_gains(network, manual_gains(network))
    upper = OracleCoordinator(gain=OracleGain(settled=settled))
    return TwoLevels(network, upper=upper).run(settled=settled, limit=ROUNDS)


def _plan(network: Network, x: np.ndarray) -> np.ndarray:
    """Return the states (n, N + 1) of a state vector in user units."""
    values = neuron_values(network, x)
    return np.vstack([values["q"], values["t"][-1:]]).T
