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

import itertools
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np

from ann_dc.analysis.linearisation import Linearisation
from ann_dc.analysis.objectives import Objective
from ann_dc.analysis.saddle import threshold_of
from ann_dc.analysis.spectra import Spectrum
from ann_dc.errors import DesignError
from ann_dc.gain_design.choice import Choice, FoundChoice
from ann_dc.gain_design.gain_rule import RECIPES, Recipe, recipe_of_first_run
from ann_dc.gain_design.gains import Gains, apply_gains
from ann_dc.gain_design.grid_gains import SettledPoint, boost_of
from ann_dc.gain_design.knowledge import NOTHING, Knowledge
from ann_dc.gain_design.refinement import refined
from ann_dc.gain_design.rule_presets import presets_of
from ann_dc.gain_design.scheduled_run import LONGEST_RUN, FirstRun, first_run
from ann_dc.gain_design.trial_run import Candidate
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.base import ALL_KINDS, Kind
from ann_dc.progress import Progress, Stopped, silent
from ann_dc.timing import phase
from ann_dc.validation.checked import checked
from ann_dc.validation.values import Own, such_as

ALTERNATIVES = 2
"""Other gains that are run where those of a design end elsewhere."""


@such_as("ann_dc.design(problem)")
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
    start : str
        Which preset the network starts from; empty if it starts where the given one does.
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
    start: str
    best: Candidate
    candidates: tuple[Candidate, ...]
    rho_star: float

    @property
    def settled(self) -> bool:
        """Whether the first run settled."""
        return self.first.settled

    def alternatives(self) -> Iterator[Design]:
        """Yield designs for the same settled point, for when a run of this one ends elsewhere.

        With other gains that settled in a rehearsal, the fastest first; then from presets.
        """
        others = (c for c in self.candidates if c is not self.best and c.settling < np.inf)
        for candidate in itertools.islice(others, ALTERNATIVES):
            network = apply_gains(self.network, candidate.gains)
            yield replace(self, network=network, gains=candidate.gains, best=candidate)
        presets = [*presets_of(self.network, self.state)]
        tried = [preset.words for preset in presets].index(self.start) + 1 if self.start else 0
        for words, state in presets[tried:]:
            yield replace(self, network=self.network.with_start(state), start=words)

    @property
    def reason(self) -> str:
        """Reason for the metric: the chosen candidate, then the best one of every other kind."""
        unsettled = "" if self.first.settled else "no optimum to read a grid off; "
        others = (
            min(found, key=lambda candidate: candidate.rank)
            for kind in RECIPES
            if kind is not self.best.kind
            and (found := [c for c in self.candidates if c.kind is kind])
        )
        return unsettled + "; ".join(map(_verdict, (self.best, *others)))

    @property
    def spectrum(self) -> Spectrum:
        """Of the frozen network at the settled point."""
        return self.best.spectrum

    @checked
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
        ended = f": {self.first.ended}" if self.first.ended else ""
        return "\n".join(
            [
                f"first run      {_ending(self.first)}{ended}",
                f"frozen with    {self.best}",
                *([f"starts from    {self.start}"] if self.start else []),
                f"because        {self.reason}",
                f"rho            {min(duals.values()):.3g} .. {max(duals.values()):.3g} "
                f"(rho* = {self.rho_star:.3g})",
                f"spectrum       radius {self.spectrum.radius:.3g}, "
                f"abscissa {self.spectrum.abscissa:.3g}",
                f"predicted      settling to 1e-6 in {predicted * self.spectrum.radius:.0f} "
                f"fastest time constants = {predicted:.3g} unit time constants",
            ]
        )


def _ending(first: FirstRun) -> str:
    ended = "settled" if first.settled and not first.found_by else "did not settle"
    found = f"; {first.found_by} found the optimum" if first.found_by else ""
    return f"{ended} in {first.steps} recurrent steps{found}"


@checked
def design(
    network: Network,
    *,
    kinds: Annotated[Iterable[Kind], Own()] = ALL_KINDS,
    recipe: Recipe | None = None,
    refine: Objective | None = None,
    limit: int = LONGEST_RUN,
    progress: Progress = silent,
    knowledge: Knowledge = NOTHING,
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
        Takes one line at a time on what is going on; where it raises `Stopped`, the design ends
        with the closed form at the state of that moment.
    knowledge : Knowledge
        Of the problem behind the network.

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
    allowed = _wirable(network, _allowed(kinds) if recipe is None else (recipe.kind,))
    with np.errstate(all="ignore"):  # a run that overflows is data
        first = first_run(
            network,
            recipe_of_first_run(recipe),
            limit=limit,
            progress=progress,
            knowledge=knowledge,
        )
        settled = SettledPoint(Linearisation(network).at(first.state), first.state)
        if first.found_by:
            first = replace(first, boost=boost_of(settled))
        choice = FoundChoice if first.found_by else Choice
        freeze = choice(allowed, recipe, first, progress, knowledge.cost)
        found, start = (), ""
        try:
            settled, found, start = _compared(freeze, settled, limit)
            if refine is not None and np.isfinite(found[0].ratio):
                better = refined(settled, found[0], progress, objective=refine)
                found = found if better is found[0] else (better, *found)
        except Stopped:
            if not found:
                settled, best = freeze.best_so_far(settled)
                found = (best,)
        return _frozen(settled, first, found, start)


@phase("gains")
def _compared(
    freeze: Choice, settled: SettledPoint, limit: int
) -> tuple[SettledPoint, tuple[Candidate, ...], str]:
    """The settled point that is kept, all candidates there, and which presets they start from."""
    if freeze.first.ended:
        raise freeze.first.ended
    return freeze.best(settled, limit)


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


def _wirable(network: Network, kinds: tuple[Kind, ...]) -> tuple[Kind, ...]:
    """Those of the kinds that a network can have: objectives act past every stiffness."""
    if not network.cell.objectives:
        return kinds
    found = tuple(kind for kind in kinds if kind not in (Kind.GRID, Kind.TREE))
    if not found:
        raise DesignError(
            "kinds: a grid or a tree couples neighbours, and objectives act on the whole row; "
            "allow Kind.PYRAMID or Kind.TIME_CONSTANTS"
        )
    return found


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
    settled: SettledPoint, first: FirstRun, found: tuple[Candidate, ...], start: str
) -> Design:
    """The network with the gains of the best candidate as its constants."""
    network, gains = settled.network, found[0].gains
    known = threshold_of(settled.saddle) if first.settled else float("nan")
    return Design(
        network=apply_gains(network, gains),
        gains=gains,
        first=first,
        state=settled.state,
        start=start,
        best=found[0],
        candidates=found,
        rho_star=known,
    )
