r"""The first run: from a naive start to a settled point, with gains recomputed on the way.

Forward Euler steps in the two-phase order (primal first, then duals on the new residual), which
is the simultaneous recurrence on the augmented Lagrangian with rho + h/tau_dual (exactly, as long
as no step is shortened). Every `CHUNK` steps the closed form is evaluated again at the current
state. A watchdog looks at windows of `PATIENCE` steps: one that improves on the best so far by less
than 3 % doubles the penalty (a rho neuron), and where the state is adrift (residual above `ADRIFT`)
the run starts again; so does one beyond `LARGEST_BOOST`, with smaller moves, while one that is near
keeps that penalty. A run that has not settled with equal rows after `EQUAL_ROWS` steps goes on
with equilibrated ones, which make slow problems several times faster and quick ones a bit slower.
Where a run stalls, or settles at a saddle, someone who knows the problem may be asked whether there
is anything to be found (`Knowledge`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ann_dc.analysis.linearisation import Linearisation
from ann_dc.analysis.saddle import saddle_of
from ann_dc.evaluation.codegen.evaluator import FastEvaluator, fast_evaluator
from ann_dc.evaluation.domains import Bounds, safe_bounds
from ann_dc.evaluation.reference import tape_with_penalty
from ann_dc.evaluation.rules import LOST, RAN, SETTLED
from ann_dc.evaluation.tape import Tape
from ann_dc.gain_design.gain_rule import Recipe, closed_form
from ann_dc.gain_design.gains import tape_with
from ann_dc.gain_design.knowledge import NOTHING, Finder, Knowledge
from ann_dc.network.network import Network
from ann_dc.progress import Progress, Stopped, silent
from ann_dc.timing import phase

LONGEST_RUN = 60_000
"""Steps, restarts included, after which a first run is given up."""
EQUAL_ROWS = 1000
"""Steps after which the rows are equilibrated."""
SWEEPS = 16
"""Sweeps of that equilibration."""
CHUNK = 25
"""Steps between two evaluations of the closed form."""
STEP = 1.2
"""Step times the largest eigenvalue of M (H + A'WA), M the metric."""
PATIENCE = 400
"""Steps of a window of the watchdog."""
WARM_UP = 100
"""Steps after a start during which the watchdog does not look: the residual starts low."""
IMPROVEMENT = 0.97
"""A window is a success when its best residual is below this share of the best so far."""
ADRIFT = 0.1
"""Residual above which a stalled run starts again instead of going on."""
LARGEST_BOOST = 64.0
"""Boost beyond which a run that is adrift starts again from 1, with half the slew."""
SHORTEST_SPAN = 0.5
"""Span that a chain is given at least: a state that ends where it began may have to move too."""
SLEW = 0.15
"""Largest move of a chain's neuron in a step, as a share of the chain's span. A step that would
move one further is shortened for all neurons alike: if only that one were held back, the duals
would wind up against it."""
LARGEST_SHARE = 2.0
"""Share of an objective, of shares that add up to one, beyond which a chunk is taken back."""
AWAY = 0.5
"""How far from where it is a run then looks, at least, for the slopes of objectives; twice as far
each time, and a tenth less after every chunk that is kept."""


@dataclass(frozen=True, kw_only=True, eq=False)
class FirstRun:
    """What the first run found.

    Attributes
    ----------
    state : (n,) array
        The last state.
    settled : bool
        Whether the relative KKT residual fell below the tolerance.
    steps : int
    boost : float
        Factor on the penalties that the watchdog arrived at.
    ended : Stopped or None
        Who ended it before it settled, and why.
    found_by : str
        Name of the search that found the state, an optimum; empty if the run itself settled there.
    """

    state: np.ndarray
    settled: bool
    steps: int
    boost: float
    ended: Stopped | None = None
    found_by: str = ""


@phase("first run")
def first_run(
    network: Network,
    recipe: Recipe,
    *,
    tolerance: float = 1e-8,
    limit: int = LONGEST_RUN,
    equal_rows: int = EQUAL_ROWS,
    progress: Progress = silent,
    knowledge: Knowledge = NOTHING,
) -> FirstRun:
    """Run a network from its start until its relative KKT residual is below ``tolerance``.

    Parameters
    ----------
    network : Network
        With PI duals; its own gains are not used.
    recipe : Recipe
        Factors of the closed form.
    tolerance : float
    limit : int
        Largest number of steps, restarts included.
    equal_rows : int
        Steps after which the rows are equilibrated.
    progress : Progress
        Takes one line a chunk.
    knowledge : Knowledge
        Its doubt is asked where the run stalls; its finder when the run is lost, or has not settled
        after ``equal_rows`` steps; if it settles, whether there is something cheaper.

    Returns
    -------
    FirstRun
        However it ended.
    """
    return _Schedule(network, recipe, equal_rows, knowledge).run(tolerance, limit, progress)


class _Schedule:
    """A first run under way: state, penalty boost, slew and watchdog."""

    def __init__(
        self, network: Network, recipe: Recipe, equal_rows: int, knowledge: Knowledge
    ) -> None:
        self.network, self.recipe, self.equal_rows = network, recipe, equal_rows
        self.knowledge, self.linear, self.is_asked = knowledge, Linearisation(network), False
        self.start = network.start_state
        self.guard = fast_evaluator(network).domain_guard(self.start)
        self.box = safe_bounds(network, self.start)
        self.slew = self._slew()
        self.boost = 1.0
        self.trial: FastEvaluator | None = None
        self.direction = np.random.default_rng(0).standard_normal(network.size)
        self.steps = 0
        self._begin()

    def _begin(self) -> None:
        """To the start, with a fresh watchdog."""
        self.x = self.start.copy()
        self.age, self.window, self.best = 0, np.inf, np.inf

    def _slew(self) -> np.ndarray:
        """Largest move of every state component (n,) in a step; only chains are limited."""
        values = self.network.unpack(self.start)
        slew = np.full(len(values), np.inf)
        for chain in self.network.cell.chains:
            rows = [self.network.neuron_index[name] for name in chain]
            slew[rows] = SLEW * max(np.ptp(values[rows]), SHORTEST_SPAN)
        return slew[self.network.places[:, 0]]

    def run(self, tolerance: float, limit: int, progress: Progress) -> FirstRun:
        outcome, ended, found_by = RAN, None, ""
        try:
            while self.steps < limit and outcome != SETTLED and not found_by:
                outcome, last = self._advance(tolerance)
                late = self.steps >= self.equal_rows and outcome != SETTLED
                ask = self.knowledge.finder
                found_by = self._found_by(ask, progress) if outcome == LOST or late else ""
                progress(
                    f"first run: step {self.steps}, KKT residual {last:.1e}, "
                    f"penalty x {self.boost:g}"
                )
            if outcome == SETTLED and saddle_of(self.network, self.x).is_minimum:
                found_by = self._found_by(self.knowledge.cheaper, progress)
            elif outcome == SETTLED:
                self.knowledge.doubt(self.x)
                found_by = self._found_by(self.knowledge.finder, progress)
        except Stopped as end:
            ended = end
        return FirstRun(
            state=self.x,
            settled=outcome == SETTLED or bool(found_by),
            steps=self.steps,
            boost=self.boost,
            ended=ended,
            found_by=found_by,
        )

    def _advance(self, tolerance: float) -> tuple[int, float]:
        """(outcome, residual) of a chunk, after which the watchdog has looked."""
        before = self.x.copy()
        done, last, outcome = self._chunk(tolerance)
        self._look_ahead(before)
        self.steps, self.age = self.steps + done, self.age + done
        if outcome == LOST:
            self.knowledge.doubt(self.x)
            self._recover()
        elif outcome != SETTLED:
            self._watch(last)
        if self.boost > LARGEST_BOOST and last < ADRIFT:
            self.boost = LARGEST_BOOST
        elif self.boost > LARGEST_BOOST:
            self.boost, self.slew = 1.0, self.slew / 2
            self._begin()
        late = self.steps >= self.equal_rows and outcome != SETTLED
        if late and not self.recipe.sweeps:
            self._equilibrate()
        return outcome, last

    def _found_by(self, ask: Finder, progress: Progress) -> str:
        """Name who has found an optimum, which is the state then; somebody is asked once."""
        if self.is_asked:
            return ""
        self.is_asked = True
        found = ask(self.x, progress)
        if found is None:
            return ""
        self.x, self.boost = found.state, 1.0
        return found.by

    def _look_ahead(self, before: np.ndarray) -> None:
        """A chunk that took a share too far is taken back, for the next one to be more careful."""
        if not len(self.linear.shares):
            return
        away = 0.9 * self.recipe.away
        most = [dual.at_rest(LARGEST_SHARE) for dual in self.network.cell.objectives]
        if not (self.x[self.linear.shares] < most).all():
            self.x, away = before, max(2 * self.recipe.away, AWAY)
        self.recipe = replace(self.recipe, away=away)

    def _equilibrate(self) -> None:
        """From here on with equilibrated rows, for which the watchdog begins anew."""
        self.recipe = replace(self.recipe, sweeps=SWEEPS)
        self.boost, self.age, self.window, self.best = 1.0, 0, np.inf, np.inf

    def _recover(self) -> None:
        """After an overflow, or a step out of a domain: smaller moves, more penalty."""
        self.slew = self.slew / 2
        self.boost *= 2
        self.steps += CHUNK  # so that a run which is lost at its first step ends too
        self._begin()

    def _chunk(self, tolerance: float) -> tuple[int, float, int]:
        """(steps done, last residual, outcome) of `CHUNK` steps with fresh gains."""
        gains = closed_form(self.linear.at(self.x), self.recipe, self.boost)
        tape = tape_with(self.network, gains)
        trial = self._renumbered(tape)
        step = STEP / self._stiffest(trial)
        follows = self.linear.dual | self.linear.diode
        ahead = np.where(follows, step * gains.rate[:, 0], 0.0)
        weights = tape_with_penalty(self.network, gains.rho + ahead).weights
        trial.renumber(tape._replace(weights=weights))
        bounds = Bounds(slew=self.slew, box=self.box, guard=self.guard)
        return trial.recur(self.x, step, bounds, count=CHUNK, tolerance=tolerance)

    def _renumbered(self, tape: Tape) -> FastEvaluator:
        if self.trial is None:
            self.trial = fast_evaluator(self.network, tape)
        self.trial.renumber(tape)
        return self.trial

    def _stiffest(self, trial: FastEvaluator) -> float:
        """Largest eigenvalue of M (H + A'WA), H of the Lagrangian, by power iterations."""
        jacobian = trial.drive_jacobian(self.x)
        primal = self.linear.primal[self.network.places[:, 0]]
        v, largest = self.direction * primal, 1.0
        for _ in range(12 if self.age == 0 else 4):
            v = v / np.linalg.norm(v)
            v = trial.move(np.ascontiguousarray((jacobian @ v) * primal))
            largest = float(np.linalg.norm(v))
        if not (np.isfinite(largest) and largest > 0):
            return 1.0
        self.direction = v
        return largest

    def _watch(self, last: float) -> None:
        """Raise the penalty where a window of steps has not improved the residual."""
        if self.age <= WARM_UP:
            return
        self.window = min(self.window, last)
        if self.age - WARM_UP < PATIENCE:
            return
        if self.window > IMPROVEMENT * self.best:
            self.knowledge.doubt(self.x)
            self.boost *= 2
            if self.window > ADRIFT:
                self._begin()
                return
            self.best = np.inf
        self.best, self.window, self.age = min(self.best, self.window), np.inf, WARM_UP + 1
