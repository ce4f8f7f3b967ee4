"""Successive screening: gains that settle fast from the starts of most inputs.

Every candidate runs on a few inputs, the better ones on more, the best on many. A fraction of 99 %
cannot be determined from a dozen samples.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ann_dc.errors import AnnDcError
from ann_dc.evaluation.codegen.evaluator import fast_evaluator
from ann_dc.evaluation.rules import LOST, SETTLED
from ann_dc.evaluation.tape import Tape, constant_values
from ann_dc.gain_design.gain_rule import GAIN_RULES, STEADIER, SWEEPS, GainRule
from ann_dc.gain_design.gains import Gains, tape_with
from ann_dc.gain_design.grid_gains import SettledPoint
from ann_dc.gain_design.trial_run import SETTLING, Pace, gains_of, run_with_constants, spectrum_with
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.base import PreconditionerKind
from ann_dc.progress import Progress

GRIDS = (PreconditionerKind.RESISTIVE_GRID, PreconditionerKind.CYCLIC_REDUCTION)
ROUNDS = ((16, 12), (64, 6), (256, 3), (1024, 1))
"""Number of inputs of every round, and number of candidates that pass it."""
ON_THE_WAY = ((0.3, 1.0, 1.0), (0.3, 0.7, 1.0), (1.0, 1.0, 1.0), (1.0, 1.0, 0.5), (0.3, 1.0, 0.5),
              (1.0, 2.0, 0.5))  # fmt: skip
"""Path term, penalty factor and multiplier rate factor of the resistive-grid candidates."""
ENOUGH = 256
"""Number of inputs after which a candidate that settled all of them is selected."""
LATE = 0.99
"""Quantile of the settling times that ranks candidates with equally many failures."""
LIMIT = 3000.0
"""Limit of a screening run in fastest time constants."""
SPECTRA = 4
"""Number of settled points at which a candidate's fastest mode is computed."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Runner:
    """Candidate gains for an operating range.

    `shared` is True if the gains come from all settled points, False if from the first one alone.
    `settling` (samples,) contains the settling times of the samples run so far, in fastest time
    constants; infinite if a sample did not settle.
    """

    gain_rule: GainRule
    penalty_factor: float
    shared: bool
    gains: Gains
    pace: Pace
    settling: np.ndarray = field(default_factory=lambda: np.empty(0))

    @property
    def share(self) -> float:
        """Fraction of its inputs for which the candidate settled."""
        return float(np.isfinite(self.settling).mean()) if len(self.settling) else 0.0

    @property
    def rank(self) -> tuple[float, float]:
        """Sort key: failures, then the settling time of most inputs."""
        settled = self.settling[np.isfinite(self.settling)]
        late = float(np.quantile(settled, LATE)) if len(settled) else np.inf
        return -self.share, late

    def __str__(self) -> str:
        rule, base = self.gain_rule, GAIN_RULES[self.gain_rule.kind]
        points = "all settled points" if self.shared else "one settled point"
        rows = f"rows of {rule.equilibration_sweeps} equilibration sweeps"
        if rule.by_reachability:
            rows = "reachability weights"
        path = f", path {rule.path_weight:g}" if rule.kind in GRIDS else ""
        return (
            f"{rule.kind.value} from {points}, {rows}{path}, penalty factor "
            f"{rule.penalty / base.penalty * self.penalty_factor:g}, multiplier rate factor "
            f"{rule.dual / base.dual:g}"
        )


def entered(
    points: Sequence[SettledPoint], kind: PreconditionerKind, penalty_factor: float
) -> list[Runner]:
    """Return the candidates of one preconditioner kind.

    The first of `points` is that of the problem itself. `penalty_factor` is the factor on
    closed-form penalties: the largest factor that a gain-scheduled run reached. Candidates that are
    unstable at a point, or without a preconditioner there, are omitted.
    """
    factor = 1.0 if kind in GRIDS else penalty_factor
    choices = (points, points[:1]) if len(points) > 1 else (points,)
    runners = []
    for gain_rule in _gain_rules(kind):
        for chosen in choices:
            try:
                gains = gains_of(chosen, gain_rule, factor)
                spectra = [spectrum_with(settled, gains) for settled in _spread(points)]
            except AnnDcError:  # no such preconditioner here: another gain rule may have one
                continue
            if all(np.isfinite(spectrum.stiffness_ratio) for spectrum in spectra):
                runner = Runner(
                    gain_rule=gain_rule,
                    penalty_factor=factor,
                    shared=chosen is points,
                    gains=gains,
                    pace=Pace.of(*spectra),
                )
                runners.append(runner)
    return runners


def _spread(points: Sequence[SettledPoint]) -> Sequence[SettledPoint]:
    """Return a few of the points, including the first and the last."""
    chosen = np.unique(np.linspace(0, len(points) - 1, SPECTRA).round().astype(int))
    return [points[i] for i in chosen]


def _gain_rules(kind: PreconditionerKind) -> Iterable[GainRule]:
    base = GAIN_RULES[kind]
    scaled = [replace(base, equilibration_sweeps=sweeps) for sweeps in SWEEPS]
    if kind in GRIDS:
        for rule, (path, penalty, dual) in itertools.product(scaled, ON_THE_WAY):
            yield replace(_multiplied(rule, penalty, dual), path_weight=path)
        return
    scaled.append(replace(base, by_reachability=True))
    for rule, (penalty, state, dual) in itertools.product(scaled, ((1.0, 1.0, 1.0), *STEADIER)):
        slower = _multiplied(rule, penalty, dual)
        yield replace(slower, state=state * base.state, target=state * base.target)


def _multiplied(rule: GainRule, penalty: float, dual: float) -> GainRule:
    """Return the rule with factors on its penalty and on the rates of its multipliers."""
    return replace(
        rule,
        penalty=penalty * rule.penalty,
        dual=dual * rule.dual,
        dual_coupling=dual * rule.dual_coupling,
    )


def raced(runners: Sequence[Runner], networks: Sequence[Network], progress: Progress) -> Runner:
    """Return the selected candidate, with its settling on the last round's inputs.

    At least one candidate is required. `networks` have the inputs and starts; the last round uses
    all of them, up to its number. `progress` receives one line per candidate and round.
    """
    left = list(runners)
    for count, through in ROUNDS:
        done = []
        for number, runner in enumerate(left, 1):
            progress(
                f"screening: {runner.gain_rule.kind.value} {number} of {len(left)}, {count} inputs"
            )
            ahead = networks[len(runner.settling) : count]
            tape = tape_with(networks[0], runner.gains)
            more = [run_sample(network, tape, runner.pace)[0] for network in ahead]
            done.append(replace(runner, settling=np.concatenate([runner.settling, more])))
        done.sort(key=lambda runner: runner.rank)
        left = done[:through]
        if count >= ENOUGH and left[0].share == 1.0:
            break
    return left[0]


def run_sample(
    network: Network, tape: Tape, pace: Pace, *, tolerance: float = SETTLING
) -> tuple[float, np.ndarray, bool]:
    """Run a network with fixed gains from its start.

    Return the settling time in fastest time constants (infinite if unsettled), the final state
    (n,), and True if the run diverged or left the domain of a function. `network` has the inputs
    and the start of a sample. `tape` has the gains and may come from any network of the operating
    range. `tolerance` is the KKT residual of a settled run.
    """
    x = network.start_state.copy()
    elapsed, outcome = run_on(network, tape, pace, x, tolerance)
    return (elapsed if outcome == SETTLED else np.inf), x, outcome == LOST


def run_on(
    network: Network, tape: Tape, pace: Pace, x: np.ndarray, tolerance: float
) -> tuple[float, int]:
    """Continue a run from a state ``x`` (n,), which is overwritten.

    Return the elapsed time in fastest time constants and the outcome code; see
    `run_with_constants`.
    """
    trial = fast_evaluator(network, tape._replace(values=constant_values(network)))
    return run_with_constants(trial, x, pace, limit=LIMIT, tolerance=tolerance)
