"""Freezing a network: which metric, which row weights and which penalty make the best constants.

The closed form is evaluated once more at the settled point, for every kind of metric that the
caller allows: a pyramid and time constants alone with a few penalties, by octaves, and a grid with
a few weights of its path term; each with equal and with equilibrated rows. What is compared is the
ratio of the spectrum; which one is taken is for the rehearsal to say (`rehearsal`). Above
`LONG_ROW` stages, where every spectrum takes long, one choice is made after the other.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ann_dc.analysis.linearisation import MeanLinearisation
from ann_dc.analysis.spectra import Spectrum, spectrum_of
from ann_dc.errors import AnnDcError
from ann_dc.gain_design.gain_rule import RECIPES, SWEEPS, Recipe, closed_form, weights_of_rows
from ann_dc.gain_design.gains import Gains, check_gains, row_with
from ann_dc.gain_design.grid_gains import SettledPoint, grid_gains_of
from ann_dc.network.preconditioners.base import Kind
from ann_dc.progress import Progress, Stopped, silent

PATHS = (0.3, 1.0, 0.1, 0.03)
"""Weights of a grid's path term that are compared."""

FINER, FINEST, HELPS = 3.0, 3, 2 / 3
"""Factor by which the smallest path term falls further, at most how often, and the factor by which
the ratio has to fall each time: where the start is far from the optimum, the term rules."""

GENTLE = 0.1
"""Factor on the weights of inequality rows of grids that are compared too: rows that press on the
way and not at the end are in no stiffness, and many of them are stiff together."""

LONG_ROW = 128
"""Stages above which weights of rows are compared at one path term or one penalty only, and the
first network that settles is taken, if no other can be faster by its ratio."""

HALF_OCTAVE = 2**0.5

LARGEST_FACTOR = 1024.0
"""How far from the first run's penalty the freeze may go, either way, before the last octave."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Candidate:
    """One way to freeze a network.

    Attributes
    ----------
    recipe : Recipe
    boost : float
        Factor on every penalty of the recipe.
    gains : Gains
        What the recipe gives at the settled point; refined ones are near it.
    spectrum : Spectrum
        Of the network with these gains, at the settled point.
    settling : float
        Fastest time constants in which a rehearsal settled from the start; infinite where it did
        not, or not before another one had; nan where there was none.
    stray : (n,) array or None
        Where a rehearsal ended that settled to another point.
    """

    recipe: Recipe
    boost: float
    gains: Gains
    spectrum: Spectrum
    settling: float = float("nan")
    stray: np.ndarray | None = None

    @property
    def kind(self) -> Kind:
        """Of the metric; a row too short for a pyramid has time constants alone."""
        return self.gains.metric.kind

    @property
    def ratio(self) -> float:
        """Of the spectrum at the settled point; infinite when it repels."""
        return self.spectrum.ratio

    @property
    def rank(self) -> tuple[float, float]:
        """What a design makes small: the settling, then the ratio, to six digits of each."""
        settling = np.inf if np.isnan(self.settling) else self.settling  # unknown comes last
        return float(f"{settling:.6g}"), float(f"{self.ratio:.6g}")

    def __str__(self) -> str:
        start = "rows by reach" if self.recipe.by_reach else "equal rows"
        rows = f"rows of {self.recipe.sweeps} sweeps" if self.recipe.sweeps else start
        path = f", path {self.recipe.path:g}" if self.kind in (Kind.GRID, Kind.TREE) else ""
        if self.recipe.inequality != 1:
            rows += f", inequalities x {self.recipe.inequality:g}"
        return f"{self.kind.value}, {rows}{path}, penalty x {self.boost:g}: ratio {self.ratio:.3g}"


def gains_of(points: Sequence[SettledPoint], recipe: Recipe, boost: float) -> Gains:
    """What a recipe gives at a settled point, or at several that one network is to have.

    Parameters
    ----------
    points : sequence of SettledPoint
        Of networks that differ in their inputs.
    recipe : Recipe
    boost : float
        Factor on every penalty.

    Returns
    -------
    Gains

    Raises
    ------
    DesignError
        If a grid's penalty lies below rho*, or its settled point is not isolated.
    """
    if len(points) == 1:
        linear, weights = points[0].linear, points[0].row_weights(recipe)
    else:
        linear = MeanLinearisation([settled.linear for settled in points])
        weights = weights_of_rows(linear, recipe)
    if recipe.kind not in (Kind.GRID, Kind.TREE):
        return closed_form(linear, recipe, boost)
    return grid_gains_of(points, weights, recipe, boost)


def candidate_of(
    settled: SettledPoint, recipe: Recipe, boost: float, progress: Progress = silent
) -> Candidate:
    """The network frozen by a recipe, with its spectrum at the settled point.

    Parameters
    ----------
    settled : SettledPoint
    recipe : Recipe
    boost : float
        Factor on every penalty of the recipe.
    progress : Progress
        Takes a line every now and then.

    Returns
    -------
    Candidate

    Raises
    ------
    DesignError, NetworkError
        If there is no grid at this point, or it is not positive definite.
    """
    gains = gains_of([settled], recipe, boost)
    found = spectrum_with(settled, gains, progress)
    return Candidate(recipe=recipe, boost=boost, gains=gains, spectrum=found)


def spectrum_with(settled: SettledPoint, gains: Gains, progress: Progress = silent) -> Spectrum:
    """Spectrum at a settled point of its network with other gains, of which only a tape is made.

    Parameters
    ----------
    settled : SettledPoint
    gains : Gains
    progress : Progress
        Takes a line every now and then, of a long row.

    Returns
    -------
    Spectrum

    Raises
    ------
    DesignError, NetworkError
        If no network can have these gains, or their metric is not positive definite.
    """
    network = settled.network
    check_gains(network, gains)
    trial = settled.trial(gains)
    row, state = row_with(network, gains), settled.state
    found = spectrum_of(trial, gains.metric, row, state, progress=progress)
    moving = (
        found.moving()
    )  # the others are multipliers of dependent rows, if primal neurons are not
    return moving if moving is not found and settled.saddle.is_convex else found


def compare(
    settled: SettledPoint,
    kind: Kind,
    boost: float,
    progress: Progress = silent,
    *,
    recipe: Recipe | None = None,
    penalty: float = 1.0,
    is_brief: bool = False,
    take: Callable[[Candidate], None] = lambda candidate: None,
) -> tuple[Candidate, ...]:
    """The candidates of one kind of metric.

    Parameters
    ----------
    settled : SettledPoint
    kind : Kind
    boost : float
        Where the search for a penalty begins: the factor that the first run arrived at.
    progress : Progress
        Takes one line a spectrum.
    recipe : Recipe, optional
        Compare its penalties only, not other ways to weigh the rows.
    penalty : float
        Factor on the penalties of the kind's own recipe.
    is_brief : bool
        Compare penalties for one way to weigh the rows, as on a long row.
    take : callable
        Takes every candidate as soon as its spectrum is known.

    Returns
    -------
    tuple of Candidate
        All that were tried, in the order of trying; none where there is no grid.
    """
    tried = _Tried(settled, kind, progress, take)
    own = replace(RECIPES[kind], penalty=penalty * RECIPES[kind].penalty)
    rows = [recipe] if recipe else [replace(own, sweeps=sweeps) for sweeps in SWEEPS]
    long = settled.network.stages > LONG_ROW
    if kind in (Kind.GRID, Kind.TREE):
        paths = [recipe.path] if recipe else list(PATHS)
        if long:
            damped = max(paths)  # it settles from the most starts
            paths.remove(damped)
            rows = [min(rows, key=lambda row: tried.ratio(replace(row, path=damped), 1.0))]
        for row, path in itertools.product(rows, paths):
            tried.ratio(replace(row, path=path), 1.0)
        if not recipe:
            _finer(tried)
            if settled.linear.diode.any():
                _gentler(tried)
    else:
        first, is_brief = boost, is_brief or long
        for row in rows if recipe else (*rows, replace(own, by_reach=True)):
            if is_brief and any(found.ratio < np.inf for found in tried.candidates):
                tried.ratio(row, boost)
            else:
                at = lambda factor, row=row: tried.ratio(row, factor)  # noqa: E731
                boost = downhill(at, boost, around=first)
    return tuple(tried.candidates)


def _finer(tried: _Tried) -> None:
    """Try smaller path terms with the best grid's rows, as long as they help."""
    best = tried.best
    if best is None or best.recipe.path > min(PATHS):
        return
    path, ratio = best.recipe.path, best.ratio
    for _ in range(FINEST):
        path, before = path / FINER, ratio
        ratio = tried.ratio(replace(best.recipe, path=path), 1.0)
        if not ratio < HELPS * before:
            return


def _gentler(tried: _Tried) -> None:
    """Try the best grid's rows with inequality rows that push less."""
    best = tried.best
    if best is not None:
        for path in sorted({*PATHS[2:], best.recipe.path}):
            tried.ratio(replace(best.recipe, path=path, inequality=GENTLE), 1.0)


@dataclass(frozen=True)
class _Tried:
    """Candidates of one kind of metric at a settled point, in the order of trying."""

    settled: SettledPoint
    kind: Kind
    progress: Progress
    take: Callable[[Candidate], None]
    candidates: list[Candidate] = field(default_factory=list)

    @property
    def best(self) -> Candidate | None:
        """The smallest ratio of those that attract."""
        attract = [found for found in self.candidates if np.isfinite(found.ratio)]
        return min(attract, key=lambda found: found.ratio, default=None)

    def ratio(self, recipe: Recipe, boost: float) -> float:
        """Of one more candidate; infinite where there is none."""
        self.progress(f"freeze: spectrum {len(self.candidates) + 1} of a {self.kind.value}")
        try:
            found = candidate_of(self.settled, recipe, boost, self.progress)
        except Stopped:
            raise
        except AnnDcError:  # no such grid here: another recipe may have one
            return np.inf
        self.candidates.append(found)
        self.take(found)
        return found.ratio if found.ratio > 0 else np.inf  # nan: the numbers overflow


def downhill(
    ratio: Callable[[float], float], boost: float, *, around: float | None = None
) -> float:
    """The penalty of the smallest ratio that octaves lead to, from the first that attracts.

    At the end half an octave is tried on either side.

    Parameters
    ----------
    ratio : callable
        Of a factor on the penalties.
    boost : float
        Where to begin.
    around : float, optional
        From which it goes no further than `LARGEST_FACTOR` either way; ``boost`` by default.

    Returns
    -------
    float
        ``boost`` itself where none attracts.
    """
    known: dict[float, float] = {}

    def at(factor: float) -> float:
        if factor not in known:
            known[factor] = ratio(factor * boost)
        return known[factor]

    factor = 1.0
    while not np.isfinite(at(factor)):
        factor *= 2
        if factor > 2 * LARGEST_FACTOR:
            return boost
    direction = min(0.5, 2.0, key=lambda step: at(factor * step))
    away = boost / (around or boost)
    while at(factor * direction) < at(factor) and (
        1 / LARGEST_FACTOR < factor * away < LARGEST_FACTOR
    ):
        factor *= direction
    return min((factor, factor * HALF_OCTAVE, factor / HALF_OCTAVE), key=at) * boost
