"""First run with gain scheduling, from a naive initial guess to a settled point.

Forward Euler steps in the two-phase order (primal, then duals on the new residual) equal the
simultaneous recurrence on the augmented Lagrangian with rho + h/tau_dual. The equality is exact if
no step is shortened. Every `CHUNK` steps the closed form is evaluated at the current state.

A watchdog checks windows of `PATIENCE` steps. A window that improves on the best residual by less
than 3 % doubles the penalty (a rho neuron). If its residual is above `_ADRIFT`, the run restarts.
Beyond `_LARGEST_BOOST` such a run restarts with smaller steps, while a run near the solution stays
at that penalty. After `EQUAL_ROWS` steps the constraint weights are equilibrated, which makes slow
problems several times faster and fast ones slightly slower. If a run stalls or settles at a saddle
point, callbacks of the problem (`Knowledge`) check whether a solution exists.
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
from ann_dc.gain_design.gain_rule import GainRule, closed_form
from ann_dc.gain_design.gains import tape_with
from ann_dc.gain_design.knowledge import NOTHING, Finder, Knowledge
from ann_dc.network.network import Network
from ann_dc.progress import Progress, Stopped, silent
from ann_dc.timing import phase

LONGEST_RUN = 60_000
"""Steps, restarts included, after which a first run ends."""
EQUAL_ROWS = 1000
"""Steps after which the constraint weights are equilibrated."""
SWEEPS = 16
"""Sweeps of that equilibration."""
CHUNK = 25
"""Steps between two evaluations of the closed form."""
STEP = 1.2
"""Step times the largest eigenvalue of M (H + A'WA), M the preconditioner."""
PATIENCE = 400
"""Steps of a window of the watchdog."""
_WARM_UP = 100
"""Steps after a start that the watchdog ignores: the initial residual is low."""
_IMPROVEMENT = 0.97
"""Ratio of a window's best residual to the best so far, below which it is a success."""
_ADRIFT = 0.1
"""Residual above which a stalled run restarts instead of continuing."""
_LARGEST_BOOST = 64.0
"""Penalty factor above which a run far from the solution restarts from 1, with half the slew."""
_SHORTEST_SPAN = 0.5
"""Smallest span of a chain: a state that ends at its initial value may also move."""
_SLEW = 0.15
"""Largest step of a chain's neuron relative to the chain's span.

A longer step is shortened for all neurons alike; if only one neuron were limited, the duals would
wind up against the limit.
"""
_LARGEST_SHARE = 2.0
"""Weight of an objective, of weights that sum to one, above which a chunk is undone."""
AWAY = 0.5
"""Smallest distance, in scales, that gradients of objectives must then cover; doubled each time,
reduced by a tenth after every accepted chunk.
"""


@dataclass(frozen=True, kw_only=True, eq=False)
class ScheduledRun:
    """Result of the first run.

    Attributes
    ----------
    settled : bool
        True if the relative KKT residual at the last `state` (n,) is below the tolerance.
    penalty_factor : float
        Final penalty factor of the watchdog.
    ended : Stopped or None
        Cause of an end before the run settled.
    found_by : str
        Name of the search that found the state, an optimum; empty if the run settled there.
    """

    state: np.ndarray
    settled: bool
    steps: int
    penalty_factor: float
    ended: Stopped | None = None
    found_by: str = ""


@phase("gain-scheduled run")
def first_run(
    network: Network,
    gain_rule: GainRule,
    *,
    tolerance: float = 1e-8,
    limit: int = LONGEST_RUN,
    equal_rows: int = EQUAL_ROWS,
    progress: Progress = silent,
    knowledge: Knowledge = NOTHING,
) -> ScheduledRun:
    """Run a network until its relative KKT residual is below ``tolerance``.

    The result is returned for every outcome. The network must have PI duals; its gains are not
    used. At most ``limit`` steps are done, restarts included; after ``equal_rows`` steps the
    constraint weights are equilibrated. The `doubt` of ``knowledge`` is called when the run stalls,
    its `finder` when the run is lost or has not settled after ``equal_rows`` steps, its `cheaper`
    when the run settles.
    """
    return _Schedule(network, gain_rule, equal_rows, knowledge).run(tolerance, limit, progress)


class _Schedule:
    """State of a first run: network state, penalty factor, slew and watchdog."""

    def __init__(
        self, network: Network, gain_rule: GainRule, equal_rows: int, knowledge: Knowledge
    ) -> None:
        self.network, self.gain_rule, self.equal_rows = network, gain_rule, equal_rows
        self.knowledge, self.linear, self.is_asked = knowledge, Linearisation(network), False
        self.start = network.start_state
        self.guard = fast_evaluator(network).domain_guard(self.start)
        self.box = safe_bounds(network, self.start)
        self.slew = self._slew()
        self.penalty_factor = 1.0
        self.trial: FastEvaluator | None = None
        self.direction = np.random.default_rng(0).standard_normal(network.size)
        self.steps = 0
        self._begin()

    def _begin(self) -> None:
        """Reset to the initial guess, with a new watchdog."""
        self.x = self.start.copy()
        self.age, self.window, self.best = 0, np.inf, np.inf

    def _slew(self) -> np.ndarray:
        """Return the largest step of every state component (n,); only chains are limited."""
        values = self.network.unpack(self.start)
        slew = np.full(len(values), np.inf)
        for chain in self.network.cell.chains:
            rows = [self.network.neuron_index[name] for name in chain]
            slew[rows] = _SLEW * max(np.ptp(values[rows]), _SHORTEST_SPAN)
        return slew[self.network.places[:, 0]]

    def run(self, tolerance: float, limit: int, progress: Progress) -> ScheduledRun:
        outcome, ended, found_by = RAN, None, ""
        try:
            while self.steps < limit and outcome != SETTLED and not found_by:
                outcome, last = self._advance(tolerance)
                late = self.steps >= self.equal_rows and outcome != SETTLED
                ask = self.knowledge.finder
                found_by = self._found_by(ask, progress) if outcome == LOST or late else ""
                progress(
                    f"gain-scheduled run: step {self.steps}, KKT residual {last:.1e}, "
                    f"penalty x {self.penalty_factor:g}"
                )
            if outcome == SETTLED and saddle_of(self.network, self.x).is_minimum:
                found_by = self._found_by(self.knowledge.cheaper, progress)
            elif outcome == SETTLED:
                self.knowledge.doubt(self.x)
                found_by = self._found_by(self.knowledge.finder, progress)
        except Stopped as end:
            ended = end
        return ScheduledRun(
            state=self.x,
            settled=outcome == SETTLED or bool(found_by),
            steps=self.steps,
            penalty_factor=self.penalty_factor,
            ended=ended,
            found_by=found_by,
        )

    def _advance(self, tolerance: float) -> tuple[int, float]:
        """Run a chunk and the watchdog; return outcome and residual."""
        before = self.x.copy()
        done, last, outcome = self._chunk(tolerance)
        self._look_ahead(before)
        self.steps, self.age = self.steps + done, self.age + done
        if outcome == LOST:
            self.knowledge.doubt(self.x)
            self._recover()
        elif outcome != SETTLED:
            self._watch(last)
        if self.penalty_factor > _LARGEST_BOOST and last < _ADRIFT:
            self.penalty_factor = _LARGEST_BOOST
        elif self.penalty_factor > _LARGEST_BOOST:
            self.penalty_factor, self.slew = 1.0, self.slew / 2
            self._begin()
        late = self.steps >= self.equal_rows and outcome != SETTLED
        if late and not self.gain_rule.equilibration_sweeps:
            self._equilibrate()
        return outcome, last

    def _found_by(self, ask: Finder, progress: Progress) -> str:
        """Call a finder once, adopt its optimum, and return its name."""
        if self.is_asked:
            return ""
        self.is_asked = True
        found = ask(self.x, progress)
        if found is None:
            return ""
        self.x, self.penalty_factor = found.state, 1.0
        return found.by

    def _look_ahead(self, before: np.ndarray) -> None:
        """Undo a chunk in which a weight grew too far; evaluate the next more carefully."""
        if not len(self.linear.shares):
            return
        away = 0.9 * self.gain_rule.linearisation_radius
        most = [dual.at_rest(_LARGEST_SHARE) for dual in self.network.cell.objectives]
        if not (self.x[self.linear.shares] < most).all():
            self.x, away = before, max(2 * self.gain_rule.linearisation_radius, AWAY)
        self.gain_rule = replace(self.gain_rule, linearisation_radius=away)

    def _equilibrate(self) -> None:
        """Continue with equilibrated constraint weights and a new watchdog."""
        self.gain_rule = replace(self.gain_rule, equilibration_sweeps=SWEEPS)
        self.penalty_factor, self.age, self.window, self.best = 1.0, 0, np.inf, np.inf

    def _recover(self) -> None:
        """Restart with smaller steps and more penalty after an overflow or domain error."""
        self.slew = self.slew / 2
        self.penalty_factor *= 2
        self.steps += CHUNK  # so that a run which is lost at its first step ends too
        self._begin()

    def _chunk(self, tolerance: float) -> tuple[int, float, int]:
        """Run `CHUNK` steps with new gains; return (steps done, last residual, outcome)."""
        gains = closed_form(self.linear.at(self.x), self.gain_rule, self.penalty_factor)
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
        """Return the largest eigenvalue of M (H + A'WA), H of the Lagrangian, iteratively."""
        jacobian = trial.drive_jacobian(self.x)
        primal = self.linear.primal[self.network.places[:, 0]]
        v, largest = self.direction * primal, 1.0
        for _ in range(12 if self.age == 0 else 4):
            v = v / np.linalg.norm(v)
            v = trial.derivative(np.ascontiguousarray((jacobian @ v) * primal))
            largest = float(np.linalg.norm(v))
        if not (np.isfinite(largest) and largest > 0):
            return 1.0
        self.direction = v
        return largest

    def _watch(self, last: float) -> None:
        """Raise the penalty if a window of steps has not improved the residual."""
        if self.age <= _WARM_UP:
            return
        self.window = min(self.window, last)
        if self.age - _WARM_UP < PATIENCE:
            return
        if self.window > _IMPROVEMENT * self.best:
            self.knowledge.doubt(self.x)
            self.penalty_factor *= 2
            if self.window > _ADRIFT:
                self._begin()
                return
            self.best = np.inf
        self.best, self.window, self.age = min(self.best, self.window), np.inf, _WARM_UP + 1
