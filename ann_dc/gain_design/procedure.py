"""Design: from a wired network to a frozen one, whose constants are R*C values.

1. First run with scheduled gains, to a settled point (`scheduled_run`).
2. Freeze (`freeze`): the closed form once more at that point, for each kind of metric that is
   allowed and each way to weigh the rows. Of those with small ratios of the spectrum the one wins
   that settles fastest from the start, with constant gains (`rehearsal`).
3. Where networks settle to another point than the first run, the freeze is done once more there.
   Where the best is slow, another first run, with equal rows to its end, may find another settled
   point, and networks that settle there several times faster.
4. Optional refinement (`refinement`) of all gains along the gradients of the eigenvalues.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from ann_dc.analysis.equilibria import equilibrium
from ann_dc.analysis.linearisation import Linearisation
from ann_dc.analysis.objectives import Objective
from ann_dc.analysis.second_order import penalty_threshold
from ann_dc.analysis.spectra import Spectrum
from ann_dc.errors import AnnDcError, DesignError, NetworkError
from ann_dc.gain_design.freeze import RECIPES, Candidate, candidate_of, compare
from ann_dc.gain_design.refinement import refined
from ann_dc.gain_design.rehearsal import ELSEWHERE, distance, rehearsed
from ann_dc.gain_design.rules.gains import Gains, apply_gains
from ann_dc.gain_design.rules.grid_gains import SettledPoint
from ann_dc.gain_design.rules.recipe import WITH_COORDINATORS, Recipe
from ann_dc.gain_design.scheduled_run import (
    EQUAL_ROWS,
    LONGEST_RUN,
    FirstRun,
    first_run,
)
from ann_dc.network.metrics.contract import ALL_KINDS, Kind
from ann_dc.network.network import Network
from ann_dc.progress import Progress, silent

SLOW = 600.0
"""Settling, in fastest time constants, beyond which another settled point is looked for."""

MUCH_FASTER = 1.5
"""How many times faster networks have to settle there to be taken."""

NEAR_LIMIT = 6.0
"""Ratio, three times the limit of 2, below which no slower kind of metric is compared any more."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Design:
    """What was designed, and why.

    Attributes
    ----------
    network : Network
        The frozen network: constant rho, time constants, metric; it starts where the given one
        started.
    gains : Gains
    first : FirstRun
        How the settled point was found.
    state : (n,) array
        The settled point to which the gains belong: where the first run ended, or another one to
        which the frozen network settled from its start.
    best : Candidate
        The metric, the factors and the penalty that won, with the spectrum at the settled point.
    candidates : tuple of Candidate
        Everything that was compared.
    rho_star : float
        The penalty above which H + rho A'A is positive definite (network units).

    Examples
    --------
    >>> from ann_dc import design, plants
    >>> designed = design(plants.double_integrator(N=5))
    >>> designed.settled, designed.spectrum.abscissa < 0
    (True, True)
    >>> designed.predicted_settling(1e-3) < designed.predicted_settling(1e-6)
    True
    """

    network: Network
    gains: Gains
    first: FirstRun
    state: np.ndarray
    best: Candidate
    candidates: tuple[Candidate, ...]
    rho_star: float

    @property
    def settled(self) -> bool:
        """Whether the first run settled."""
        return self.first.settled

    @property
    def reason(self) -> str:
        """Why this metric: the best of every kind that was compared, in one sentence each."""
        unsettled = "" if self.first.settled else "no optimum to read a grid off; "
        return unsettled + "; ".join(
            _verdict(min(found, key=lambda candidate: candidate.rank))
            for kind in RECIPES
            if (found := [c for c in self.candidates if c.kind is kind])
        )

    @property
    def spectrum(self) -> Spectrum:
        """Of the frozen network at the settled point."""
        return self.best.spectrum

    def predicted_settling(self, tolerance: float = 1e-6) -> float:
        """Network time that the slowest mode needs: ln(1/tolerance) / |abscissa|.

        Parameters
        ----------
        tolerance : float
            What a deviation falls to, relative to its start.

        Returns
        -------
        float
            In units of network time; infinite where the point repels.
        """
        abscissa = self.spectrum.abscissa
        return float(np.log(1 / tolerance) / -abscissa) if abscissa < 0 else float("inf")

    def __str__(self) -> str:
        duals = {
            d.neuron: self.gains.rho[self.network.neuron_index[d.neuron]]
            for d in self.network.cell.duals
        }
        predicted = self.predicted_settling()
        return "\n".join(
            [
                f"first run      {'settled' if self.first.settled else 'did not settle'} in "
                f"{self.first.steps} recurrent steps",
                f"frozen with    {self.best}",
                f"because        {self.reason}",
                f"rho            {min(duals.values()):.3g} .. {max(duals.values()):.3g} "
                f"(rho* = {self.rho_star:.3g})",
                f"spectrum       radius {self.spectrum.radius:.3g}, "
                f"abscissa {self.spectrum.abscissa:.3g}",
                f"predicted      settling to 1e-6 in {predicted:.3g} units of network time, "
                f"{predicted * self.spectrum.radius:.0f} fastest time constants",
            ]
        )


def design(
    network: Network,
    *,
    kinds: Iterable[Kind] = ALL_KINDS,
    recipe: Recipe | None = None,
    refine: Objective | None = None,
    limit: int = LONGEST_RUN,
    progress: Progress = silent,
) -> Design:
    """Choose rho, time constants and metric of a network.

    Parameters
    ----------
    network : Network
        With PI duals.
    kinds : iterable of Kind
        The metrics among which to choose; all by default. Where the first run does not settle, a
        pyramid stands in for a grid or a tree.
    recipe : Recipe, optional
        Fixes the closed form's factors and the kind of metric, whatever ``kinds`` says; the best
        of `RECIPES` by default.
    refine : Objective, optional
        Refine all gains afterwards, along the gradients of the eigenvalues, so that this becomes
        small: `SETTLING_TIME` for continuous time, `STEPS` or `TWO_PHASE_STEPS` for recurrent
        layers. Some 20 seconds.
    limit : int
        Largest number of steps of the first run.
    progress : Progress
        Takes one line at a time on what is going on.

    Returns
    -------
    Design
        Whatever the outcome: a first run that does not settle says so in ``settled``.

    Raises
    ------
    DesignError
        If the network has no PI duals, its numbers overflow, no kind is allowed, or there is no
        metric of the only kind that is.

    Examples
    --------
    >>> from ann_dc import plants, synthesize
    >>> network = synthesize(plants.double_integrator(N=5))
    >>> design(network, kinds=[Kind.PYRAMID]).best.kind
    <Kind.PYRAMID: 'pyramid of coarse coordinators'>
    """
    if not network.cell.duals:
        raise DesignError(
            "design: this network has no PI dual neurons, so there is no rho to "
            "choose; set the time constants of its neurons by hand"
        )
    allowed = _allowed(kinds) if recipe is None else (recipe.kind,)
    with np.errstate(all="ignore"):  # a run that overflows is data
        first = first_run(network, _first_recipe(recipe), limit=limit, progress=progress)
        settled = SettledPoint(Linearisation(network).at(first.state), first.state)
        freeze = _Freeze(allowed, recipe, first, progress)
        found = freeze.at(settled)
        if first.settled:
            settled, found = freeze.followed(settled, found)
            settled, found = freeze.elsewhere(settled, found, limit)
        best = found[0]
        if refine is not None and np.isfinite(best.ratio):
            better = refined(settled, best, progress, objective=refine)
            if better is not best:
                best, found = better, (better, *found)
        return _frozen(settled, first, best, found)


def _allowed(kinds: Iterable[Kind]) -> tuple[Kind, ...]:
    if isinstance(kinds, Kind):
        raise DesignError(f"kinds: expected several, got {kinds}; write [{kinds}]")
    given = tuple(kinds)
    strange = [kind for kind in given if not isinstance(kind, Kind)]
    if strange or not given:
        raise DesignError(
            f"kinds: expected some of {', '.join(f'Kind.{kind.name}' for kind in Kind)}, got "
            f"{given!r}"
        )
    return tuple(kind for kind in RECIPES if kind in given)


def _first_recipe(recipe: Recipe | None) -> Recipe:
    """The factors of the first run, which has no grid: it knows no settled point yet."""
    if recipe is None or recipe.kind in (Kind.GRID, Kind.TREE):
        return WITH_COORDINATORS
    return recipe


@dataclass(frozen=True)
class _Freeze:
    """The kinds that are allowed, in turn, until one is near the limit."""

    kinds: tuple[Kind, ...]
    recipe: Recipe | None
    first: FirstRun
    progress: Progress

    def at(self, settled: SettledPoint) -> tuple[Candidate, ...]:
        """All candidates at a settled point, the best first."""
        found = ()
        for kind in self._useful():
            compared = self._compared(settled, kind)
            found = rehearsed(settled, (*found, *compared), self.progress)
            if found and found[0].settling < np.inf and found[0].ratio < NEAR_LIMIT:
                break
        if not found:
            # the only kind that is allowed has no metric here: let it say why
            return (candidate_of(settled, self.recipe or RECIPES[self.kinds[0]], 1.0),)
        return found

    def _useful(self) -> tuple[Kind, ...]:
        """No tree where there is a grid, which is the same metric; no grid without an optimum."""
        kinds = self.kinds
        if Kind.GRID in kinds:
            kinds = tuple(kind for kind in kinds if kind is not Kind.TREE)
        others = tuple(kind for kind in kinds if kind not in (Kind.GRID, Kind.TREE))
        return kinds if self.first.settled else others or (Kind.PYRAMID,)

    def _compared(self, settled: SettledPoint, kind: Kind) -> tuple[Candidate, ...]:
        fixed = self.recipe if self.recipe is not None and self.recipe.kind is kind else None
        return compare(settled, kind, self.first.boost, self.progress, recipe=fixed)

    def followed(
        self, settled: SettledPoint, found: tuple[Candidate, ...]
    ) -> tuple[SettledPoint, tuple[Candidate, ...]]:
        """The freeze where networks settle to, if none settles where the first run did."""
        strays = [candidate.stray for candidate in found if candidate.stray is not None]
        if found[0].settling < np.inf or not strays:
            return settled, found
        try:
            state = equilibrium(settled.network, strays[0])
        except NetworkError:
            return settled, found
        other = SettledPoint(settled.linear.at(state), state)
        there = self._at_another(other)
        return (other, there) if there and there[0].settling < np.inf else (settled, found)

    def _at_another(self, other: SettledPoint) -> tuple[Candidate, ...]:
        """Candidates at a point that nobody asked for; none where there is no metric."""
        try:
            return self.at(other)
        except AnnDcError:
            return ()

    def elsewhere(
        self, settled: SettledPoint, found: tuple[Candidate, ...], limit: int
    ) -> tuple[SettledPoint, tuple[Candidate, ...]]:
        """The freeze where a run with equal rows settles, if networks are much faster there."""
        if found[0].rank[0] < SLOW or self.first.steps < EQUAL_ROWS:
            return settled, found
        second = first_run(
            settled.network,
            _first_recipe(self.recipe),
            limit=limit,
            equal_rows=limit,
            progress=self.progress,
        )
        if not second.settled or distance(settled, second.state) < ELSEWHERE:
            return settled, found
        other = SettledPoint(settled.linear.at(second.state), second.state)
        there = replace(self, first=second)._at_another(other)
        faster = there and MUCH_FASTER * there[0].rank[0] < found[0].rank[0]
        return (other, there) if faster else (settled, found)


def _verdict(candidate: Candidate) -> str:
    """What became of a kind."""
    if candidate.settling < np.inf:
        outcome = f"settles in {candidate.settling:.0f} fastest time constants"
    elif candidate.settling == np.inf:
        outcome = "does not settle from the start, or later"
    else:
        outcome = "is too slow to rehearse" if np.isfinite(candidate.ratio) else "repels"
    return f"{candidate.kind.value} {outcome} (ratio {candidate.ratio:.3g})"


def _frozen(
    settled: SettledPoint, first: FirstRun, best: Candidate, candidates: tuple[Candidate, ...]
) -> Design:
    """The network with the gains of the best candidate as its constants."""
    network, gains = settled.network, best.gains
    if not (np.isfinite(gains.rate).all() and (gains.rate > 0).all()):
        raise DesignError(
            f"{network.title}: the gains overflow; choose units in which states and controls are "
            "near 1"
        )
    known = penalty_threshold(network, settled.state) if first.settled else float("nan")
    return Design(
        network=apply_gains(network, gains),
        gains=gains,
        first=first,
        state=settled.state,
        best=best,
        candidates=candidates,
        rho_star=known,
    )
