"""Refinement of the best candidate's gains by eigenvalue gradients.

The wires are unchanged. L-BFGS varies the logarithms of time constants, penalties and coarse gains
to minimise the time of the slowest mode. The objective is an average over the designed network and
copies with random errors of a few per cent in all gains. An optimum for exact gains only would be
of little use. The smoothed maximum over the modes is sharpened during the search. A result is
accepted only if it is better and its constant gains settle from the initial guess.
"""

from __future__ import annotations

import enum
import time as clock
from collections.abc import Callable, Hashable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from ann_dc.analysis.objectives import SETTLING_TIME, Objective
from ann_dc.analysis.saddle import saddle_of
from ann_dc.analysis.spectra import DENSE_LIMIT
from ann_dc.gain_design.eigenvalue_gradient import (
    STEPS_TRIED,
    DenseFlow,
    coarse_neurons,
    dense_preconditioner,
    scaled_preconditioner,
)
from ann_dc.gain_design.gains import Gains
from ann_dc.gain_design.grid_gains import SettledPoint
from ann_dc.gain_design.trial_run import Candidate, spectrum_with, with_trial_run
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.base import Preconditioner
from ann_dc.progress import Paced, Progress, silent
from ann_dc.timing import phase

SECONDS = 20.0
"""Limit of processor time in seconds; independent of the load of the machine."""
STAGES = ((30.0, 1, 0.6), (150.0, 3, 1.0))
"""Successive searches: p of the smoothed maximum, copies, fraction of the time at the end."""
ITERATIONS = 150
"""Largest number of L-BFGS iterations of one stage."""
ERROR = 0.05
"""Standard deviation of the logarithms of all gains of a copy."""
LARGEST_FACTOR = 1e3
"""Largest factor from the given gains, in either direction."""
FLOOR = 0.1
"""Decay, relative to that of the given gains, below which the objective is linear."""
_WAYS_BACK = (1.0, 0.5, 0.25)
"""Fractions of the (logarithmic) distance to the optimum, tried until one settles."""


class Freedom(enum.Enum):
    """Independent gains of a refinement; the value is the sentence that is displayed.

    Penalties always belong to the dual neuron of a constraint. A dual rate is proportional to its
    penalty, times an independent factor.
    """

    GAIN_RULE = "a rate a population, a penalty a state component, one coarse gain"
    NEURON = "a rate and a penalty a neuron of the cell, a coarse gain a level and component"
    EACH = "a rate a neuron and stage, a penalty a neuron of the cell, a gain a coarse neuron"


@phase("refinement")
def refined(
    settled: SettledPoint,
    best: Candidate,
    progress: Progress = silent,
    *,
    seconds: float = SECONDS,
    freedom: Freedom = Freedom.NEURON,
    objective: Objective = SETTLING_TIME,
) -> Candidate:
    """Return a better candidate than ``best`` with the same wires, or ``best`` itself.

    Every evaluation computes all eigenvalues and eigenvectors. Above `DENSE_LIMIT` neurons this is
    too expensive, and ``best`` is returned with a message. ``best`` must have a finite stiffness
    ratio. The search ends after a processor time in ``seconds``; the last evaluation and the
    settling check take additional time.
    """
    began, network, state = clock.process_time(), settled.network, settled.state
    if network.size > DENSE_LIMIT:
        progress(
            f"refine: omitted, {network.size} neurons exceed the limit {DENSE_LIMIT} for the "
            "computation of eigenvectors"
        )
        return best
    around = Variation.of(network, state, best.gains, freedom, objective)
    if not np.isfinite(around.flow.slowness(around.gains, objective)):
        progress("refine: omitted, the candidate is unstable")
        return best
    x = _Search(around, began, seconds, progress).best
    for share in _WAYS_BACK:
        if not around.is_better(share * x):
            continue
        gains = around.gains_at(share * x)
        modes = spectrum_with(settled, gains)
        better = with_trial_run(settled, replace(best, gains=gains, spectrum=modes))
        if better.settling < np.inf:
            return better
    progress("refine: no better candidate settles from the initial guess")
    return best


@dataclass(frozen=True, kw_only=True, eq=False)
class Variation:
    """Gains around given gains, as functions of x: log gains = log given + share x.

    `given` are the gains at x = 0, `gains` (g,) the same as a `DenseFlow` vector with the best
    step, and `flow` is the flow at the settled point. `share` (g, v) contains the coefficients of
    the v variables.
    """

    network: Network
    given: Gains
    flow: DenseFlow
    objective: Objective
    gains: np.ndarray
    share: np.ndarray

    @classmethod
    def of(
        cls,
        network: Network,
        state: np.ndarray,
        given: Gains,
        freedom: Freedom,
        objective: Objective,
    ) -> Variation:
        """Return the variation allowed by ``freedom`` at a settled state (n,)."""
        saddle = saddle_of(network, state)
        row = replace(network.layout, rates=np.where(network.live, given.rate, 0.0))
        flow = DenseFlow(
            saddle=saddle,
            preconditioner=dense_preconditioner(given.preconditioner, row, saddle.primal),
        )
        neuron, stage = network.places.T
        rates = given.rate[neuron, stage]
        nodes = np.ones(len(coarse_neurons(given.preconditioner)))
        gains = np.concatenate(
            [rates[saddle.primal], rates[saddle.dual], given.rho[neuron[saddle.dual]], nodes, [1.0]]
        )
        if objective.stepped:
            gains[-1] = flow.near_best_step(gains, objective)
        return cls(
            network=network,
            given=given,
            flow=flow,
            objective=objective,
            gains=gains,
            share=_share(network, flow, given.preconditioner, freedom, objective),
        )

    def at(self, x: np.ndarray) -> np.ndarray:
        """Return the gains (g,) as a `DenseFlow` vector."""
        return self.gains * np.exp(self.share @ x)

    def is_better(self, x: np.ndarray) -> bool:
        """Return True if the unsmoothed objective is smaller at x than at zero."""
        slowness = self.flow.slowness
        return slowness(self.at(x), self.objective) < slowness(self.gains, self.objective)

    def gains_at(self, x: np.ndarray) -> Gains:
        """Return the gains of a network."""
        saddle, live = self.flow.saddle, self.network.live
        primal, dual, penalty, nodes, _ = self.flow.split(np.exp(self.share @ x))
        neuron, stage = self.network.places.T
        rate, rho = np.ones(live.shape), self.given.rho.copy()
        rate[neuron[saddle.primal], stage[saddle.primal]] = primal
        rate[neuron[saddle.dual], stage[saddle.dual]] = dual
        # where a neuron is pinned its rate is that of its first live stage: one number a neuron
        first = rate[np.arange(len(rate)), live.argmax(axis=1)]
        rate = np.where(live, rate, first[:, None])
        factor = np.ones(len(rho))
        factor[neuron[saddle.dual]] = penalty
        return Gains(
            rho=rho * factor,
            rate=self.given.rate * rate,
            preconditioner=scaled_preconditioner(self.given.preconditioner, nodes),
        )


def best_step(network: Network, state: np.ndarray, gains: Gains, objective: Objective) -> float:
    """Return the step h that needs the fewest steps to settle, near a settled state.

    `gains` are those of the network at the settled `state` (n,), `objective` is `STEPS` or
    `TWO_PHASE_STEPS`. h is in units of network time.

    Examples
    --------
    >>> from ann_dc import design, plants
    >>> from ann_dc.analysis import STEPS
    >>> found = design(plants.double_integrator(N=5))
    >>> h = best_step(found.network, found.state, found.gains, STEPS)
    >>> 0 < h < found.spectrum.largest_step
    True
    """
    around = Variation.of(network, state, gains, Freedom.GAIN_RULE, objective)
    flow, near = around.flow, np.log(around.gains[-1])

    def slowness(log_step: float) -> float:
        slow = flow.slowness(np.append(around.gains[:-1], np.exp(log_step)), objective)
        return min(slow, 1e9)  # the search takes finite numbers

    spacing = np.log(STEPS_TRIED[1] / STEPS_TRIED[0])
    from scipy.optimize import minimize_scalar  # loads slowly, and few refine

    found = minimize_scalar(slowness, bounds=(near - spacing, near + spacing), method="bounded")
    return float(np.exp(found.x))


def _share(
    network: Network,
    flow: DenseFlow,
    preconditioner: Preconditioner,
    freedom: Freedom,
    objective: Objective,
) -> np.ndarray:
    """Return the coefficients (g, v) of the variables in every gain."""
    neurons = network.cell.neurons
    rates: dict[Freedom, Callable[[int, int], Hashable]] = {
        Freedom.GAIN_RULE: lambda neuron, stage: neurons[neuron].population,
        Freedom.NEURON: lambda neuron, stage: neuron,
        Freedom.EACH: lambda neuron, stage: (neuron, stage),
    }
    nodes: dict[Freedom, Callable[[int, int, int], Hashable]] = {
        Freedom.GAIN_RULE: lambda *node: "coarse",
        Freedom.NEURON: lambda level, point, chain: (level, chain),
        Freedom.EACH: lambda *node: node,
    }
    primal, dual = (network.places[part] for part in (flow.saddle.primal, flow.saddle.dual))
    by_component = freedom is Freedom.GAIN_RULE
    rate = [("rate", rates[freedom](*place)) for place in (*primal, *dual)]
    penalty = [("penalty", neurons[i].component if by_component else i) for i, _ in dual]
    node = [("node", nodes[freedom](*place)) for place in coarse_neurons(preconditioner)]
    first = _indicator([*rate, *penalty, *node, ("step",)])
    # a dual rate follows its penalty
    z, d = len(primal), len(dual)
    first[z : z + d] += first[z + d : z + 2 * d]
    return first if objective.stepped else first[:, :-1]


def _indicator(labels: Sequence[Hashable]) -> np.ndarray:
    """Return an indicator matrix with one column per label, in order of appearance."""
    columns = {label: column for column, label in enumerate(dict.fromkeys(labels))}
    return np.eye(len(columns))[[columns[label] for label in labels]]


class _Spent(Exception):
    """Raised when the time limit is reached."""


class _Search:
    """L-BFGS search: clock, copies, and best result."""

    def __init__(self, around: Variation, began: float, seconds: float, progress: Progress) -> None:
        self.around, self.tell = around, Paced(progress)
        self.best = np.zeros(around.share.shape[1])
        self.reported = around.flow.slowness(around.gains, around.objective)
        self.floor = FLOOR / self.reported
        most = 1 + max(copies for _, copies, _ in STAGES)
        errors = ERROR * np.random.default_rng(0).standard_normal((most, len(around.gains)))
        errors[0] = 0.0  # the network as designed
        errors[:, -1] = 0.0  # a step is a number, not a part
        self.errors = np.exp(errors)
        for sharpness, copies, share in STAGES:
            self._stage(sharpness, copies, began + share * seconds)

    def _stage(self, sharpness: float, copies: int, deadline: float) -> None:
        """Run one search from the best result; the first evaluation resets the best value."""
        self.sharpness, self.deadline = sharpness, deadline
        self.factors, self.smallest = self.errors[: 1 + copies], np.inf
        from scipy.optimize import minimize  # loads slowly, and few refine

        bound = np.log(LARGEST_FACTOR)
        with suppress(_Spent, np.linalg.LinAlgError):
            minimize(
                self._average,
                self.best,
                jac=True,
                method="L-BFGS-B",
                bounds=[(-bound, bound)] * len(self.best),
                options={"maxiter": ITERATIONS, "maxcor": 20},
            )

    def _average(self, x: np.ndarray) -> tuple[float, np.ndarray]:
        """Return value and gradient of the objective, averaged over all copies."""
        around, gains, found = self.around, self.around.at(x), []
        for factors in self.factors:
            if clock.process_time() > self.deadline:
                raise _Spent
            found.append(
                around.flow.smoothed(gains * factors, around.objective, self.sharpness, self.floor)
            )
        average = float(np.mean([np.log(one.slowness) for one in found]))
        if average < self.smallest:
            self.best, self.smallest, self.reported = x.copy(), average, found[0].slowness
        self.tell(lambda: f"refine: {around.objective.unit} {self.reported:.3g}")
        gradient = around.share.T @ np.mean([one.gradient for one in found], axis=0)
        return float(np.mean([one.value for one in found])), gradient
