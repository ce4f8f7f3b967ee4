"""The race: which constants settle from the starts of most inputs, and how fast.

Every candidate runs on a few inputs, the better ones on more, the best on many: a share of 99 % is
nothing that a dozen of samples could tell.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ann_dc.errors import AnnDcError
from ann_dc.evaluation.codegen.evaluator import fast_evaluator
from ann_dc.evaluation.rules import LOST, SETTLED
from ann_dc.evaluation.tape import Tape, constant_values
from ann_dc.gain_design.gain_rule import RECIPES, STEADIER, SWEEPS, Recipe
from ann_dc.gain_design.gains import Gains, tape_with
from ann_dc.gain_design.grid_gains import SettledPoint
from ann_dc.gain_design.trial_run import SETTLING, Pace, gains_of, run_with_constants, spectrum_with
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.base import Kind
from ann_dc.progress import Progress

ROUNDS = ((16, 12), (64, 6), (256, 3), (1024, 1))
"""Inputs of every round, and how many candidates come through it."""
ON_THE_WAY = ((0.3, 1.0, 1.0), (0.3, 0.7, 1.0), (1.0, 1.0, 1.0), (1.0, 1.0, 0.5), (0.3, 1.0, 0.5),
              (1.0, 2.0, 0.5))  # fmt: skip
"""Path term, factor on the penalty and on the rates of multipliers of the grids that race."""
ENOUGH = 256
"""Inputs after which a candidate that settled all of them has won."""
LATE = 0.99
"""Share of the settled inputs by whose settling candidates with as many failures are told apart."""
LIMIT = 3000.0
"""Fastest time constants after which a run of a race is given up."""
SPECTRA = 4
"""Settled points at which a candidate's fastest mode is looked for."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Runner:
    """Constants that race for a family.

    Attributes
    ----------
    recipe : Recipe
    boost : float
        Factor on every penalty.
    shared : bool
        Whether the gains are read off all settled points, or off the first one alone.
    gains : Gains
    pace : Pace
    settling : (samples,) array
        Fastest time constants, sample by sample as far as it has run; infinite where it did not
        settle.
    """

    recipe: Recipe
    boost: float
    shared: bool
    gains: Gains
    pace: Pace
    settling: np.ndarray = field(default_factory=lambda: np.empty(0))

    @property
    def share(self) -> float:
        """Of the inputs that it ran on and settled."""
        return float(np.isfinite(self.settling).mean()) if len(self.settling) else 0.0

    @property
    def rank(self) -> tuple[float, float]:
        """What a race makes small: failures, then how long most inputs take."""
        settled = self.settling[np.isfinite(self.settling)]
        late = float(np.quantile(settled, LATE)) if len(settled) else np.inf
        return -self.share, late

    def __str__(self) -> str:
        recipe, factor = self.recipe, self.recipe.penalty / RECIPES[self.recipe.kind].penalty
        rows = "rows by reach" if recipe.by_reach else f"rows of {recipe.sweeps} sweeps"
        path = f", path {recipe.path:g}" if recipe.kind in (Kind.GRID, Kind.TREE) else ""
        off = "all settled points" if self.shared else "one settled point"
        return (
            f"{recipe.kind.value} from {off}, {rows}{path}, penalty x {factor * self.boost:g}, "
            f"rates of multipliers x {recipe.dual / RECIPES[recipe.kind].dual:g}"
        )


def entered(points: Sequence[SettledPoint], kind: Kind, boost: float) -> list[Runner]:
    """The candidates of one kind of metric.

    Parameters
    ----------
    points : sequence of SettledPoint
        That of the problem itself first.
    kind : Kind
    boost : float
        Factor on the penalties of a closed form: the largest that a first run arrived at.

    Returns
    -------
    list of Runner
        None that repels at one of the points, or has no metric there.
    """
    runners = []
    for recipe in _recipes(kind):
        factor = 1.0 if kind in (Kind.GRID, Kind.TREE) else boost
        for off in (points, points[:1]) if len(points) > 1 else (points,):
            try:
                gains = gains_of(off, recipe, factor)
                found = [spectrum_with(settled, gains) for settled in _spread(points)]
            except AnnDcError:  # no such metric here: another recipe may have one
                continue
            if all(np.isfinite(spectrum.ratio) for spectrum in found):
                shared, pace = off is points, Pace.of(*found)
                runners.append(
                    Runner(recipe=recipe, boost=factor, shared=shared, gains=gains, pace=pace)
                )
    return runners


def _spread(points: Sequence[SettledPoint]) -> Sequence[SettledPoint]:
    """A few of the points, the first and the last among them."""
    chosen = np.unique(np.linspace(0, len(points) - 1, SPECTRA).round().astype(int))
    return [points[i] for i in chosen]


def _recipes(kind: Kind) -> Iterable[Recipe]:
    own = RECIPES[kind]
    if kind in (Kind.GRID, Kind.TREE):
        for sweeps in SWEEPS:
            for path, penalty, dual in ON_THE_WAY:
                yield replace(
                    own, sweeps=sweeps, path=path, penalty=penalty * own.penalty,
                    dual=dual * own.dual, dual_coupling=dual * own.dual_coupling,
                )  # fmt: skip
        return
    for rows in (*(replace(own, sweeps=sweeps) for sweeps in SWEEPS), replace(own, by_reach=True)):
        for penalty, state, dual in ((1.0, 1.0, 1.0), *STEADIER):
            yield replace(
                rows, penalty=penalty * own.penalty, state=state * own.state,
                target=state * own.target, dual=dual * own.dual,
                dual_coupling=dual * own.dual_coupling,
            )  # fmt: skip


def raced(runners: Sequence[Runner], networks: Sequence[Network], progress: Progress) -> Runner:
    """The winner.

    Parameters
    ----------
    runners : sequence of Runner
        One at least.
    networks : sequence of Network
        With the inputs and starts on which they run; the last round takes all there are, up to
        its number.
    progress : Progress
        Takes one line a candidate and round.

    Returns
    -------
    Runner
        With its settling on the inputs of the last round.
    """
    left = list(runners)
    for count, through in ROUNDS:
        done = []
        for number, runner in enumerate(left, 1):
            progress(f"race: {runner.recipe.kind.value} {number} of {len(left)}, {count} inputs")
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
    """Run a frozen network from its start.

    Parameters
    ----------
    network : Network
        With the inputs and the start of a sample.
    tape : Tape
        With its constants, of any network of the family.
    pace : Pace
    tolerance : float
        KKT residual to which it has to settle.

    Returns
    -------
    settling : float
        Fastest time constants; infinite where it did not settle.
    x : (n,) array
        Where it ended.
    lost : bool
        Whether it diverged, or left the domain of a function.
    """
    x = network.start_state.copy()
    elapsed, outcome = run_on(network, tape, pace, x, tolerance)
    return (elapsed if outcome == SETTLED else np.inf), x, outcome == LOST


def run_on(
    network: Network, tape: Tape, pace: Pace, x: np.ndarray, tolerance: float
) -> tuple[float, int]:
    """Go on from a state ``x`` (n,), which is overwritten; see `run_with_constants`.

    Returns
    -------
    elapsed : float
        Fastest time constants.
    outcome : int
    """
    trial = fast_evaluator(network, tape._replace(values=constant_values(network)))
    return run_with_constants(trial, x, pace, limit=LIMIT, tolerance=tolerance)
