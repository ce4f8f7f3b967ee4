"""Gain design: from a wired network to constant gains, realised as R*C values.

1. First run with gain scheduling, to a settled point (`scheduled_run`).
2. Candidates (`choice`): the closed form is evaluated at that point for every allowed
   preconditioner kind and several constraint weights. Of the candidates with small stiffness
   ratios, the one that settles fastest from the initial guess with constant gains is chosen
   (`trial_run`).
3. If networks settle to another point than the first run, step 2 is repeated there. If the best is
   slow, another first run, with equal weights throughout, may find another settled point with
   networks that settle several times faster.
4. Optional refinement (`refinement`) of all gains along the gradients of the eigenvalues.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np

from ann_dc.analysis.linearisation import Linearisation
from ann_dc.analysis.objectives import Objective
from ann_dc.analysis.saddle import threshold_of
from ann_dc.analysis.spectra import Spectrum
from ann_dc.errors import DesignError, such_as
from ann_dc.gain_design.choice import Choice, FoundChoice
from ann_dc.gain_design.gain_rule import GAIN_RULES, GainRule, recipe_of_first_run
from ann_dc.gain_design.gains import Gains, apply_gains
from ann_dc.gain_design.grid_gains import SettledPoint, boost_of
from ann_dc.gain_design.knowledge import NOTHING, Knowledge
from ann_dc.gain_design.refinement import refined
from ann_dc.gain_design.rule_presets import presets_of
from ann_dc.gain_design.scheduled_run import LONGEST_RUN, ScheduledRun, first_run
from ann_dc.gain_design.trial_run import Candidate
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.base import ALL_KINDS, Kinds, PreconditionerKind, several
from ann_dc.progress import Progress, Stopped, silent
from ann_dc.summaries import summarised
from ann_dc.timing import phase
from ann_dc.validation import Own, checked

_ALTERNATIVES = 2
"""Number of other gains that are run if those of a design settle elsewhere."""


@such_as("ann_dc.design(problem)")
@summarised(
    lambda self: {
        "network": self.network.title,
        "preconditioner": self.best.kind.value,
        "settled": "yes" if self.settled else "no",
        "stiffness ratio": f"{self.best.ratio:.4g}",
    }
)
@dataclass(frozen=True, kw_only=True, eq=False)
class Design:
    """Designed gains of a network, with the reasons for their choice.

    Attributes
    ----------
    network : Network
        Network with constant rho, time constants and preconditioner; its initial guess is that of
        the given network unless ``start`` names a preset.
    gains : Gains
        Gains of ``network``.
    first : FirstRun
        Run that found the settled point.
    state : (n,) array
        Settled point of the gains: the end of the first run, or another point to which the network
        with fixed gains settled from its initial guess.
    start : str
        Preset that is the initial guess; empty for the given initial guess.
    best : Candidate
        Chosen preconditioner, factors and penalty, with the spectrum at the settled point.
    candidates : tuple of Candidate
        All candidates compared.
    rho_star : float
        Penalty threshold above which H + rho A'A is positive definite (network units).

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
    first: ScheduledRun
    state: np.ndarray
    start: str
    best: Candidate
    candidates: tuple[Candidate, ...]
    rho_star: float

    @property
    def settled(self) -> bool:
        """True if the first run settled."""
        return self.first.settled

    def alternatives(self) -> Iterator[Design]:
        """Yield designs for the same settled point, for use if a run settles elsewhere.

        The first designs have other gains that settled in a trial run, the fastest first; the next
        ones start from presets.
        """
        others = (c for c in self.candidates if c is not self.best and c.settling < np.inf)
        for candidate in itertools.islice(others, _ALTERNATIVES):
            network = apply_gains(self.network, candidate.gains)
            yield replace(self, network=network, gains=candidate.gains, best=candidate)
        presets = [*presets_of(self.network, self.state)]
        tried = [preset.words for preset in presets].index(self.start) + 1 if self.start else 0
        for words, state in presets[tried:]:
            yield replace(self, network=self.network.with_start(state), start=words)

    @property
    def reason(self) -> str:
        """Results of the chosen candidate and of the best candidate of every other kind."""
        unsettled = "" if self.first.settled else "no settled point for a grid; "
        others = (
            min(found, key=lambda candidate: candidate.rank)
            for kind in GAIN_RULES
            if kind is not self.best.kind
            and (found := [c for c in self.candidates if c.kind is kind])
        )
        return unsettled + "; ".join(map(_verdict, (self.best, *others)))

    @property
    def spectrum(self) -> Spectrum:
        """Spectrum of the network with fixed gains at the settled point."""
        return self.best.spectrum

    @checked
    def predicted_settling(self, tolerance: float = 1e-6) -> float:
        """Compute the network time of the slowest mode: ``ln(1/tolerance) / |abscissa|``.

        Parameters
        ----------
        tolerance : float
            Final deviation relative to the initial deviation. Default 1e-6.

        Returns
        -------
        float
            Settling time in units of network time; infinite if the point is unstable.
        """
        abscissa = self.spectrum.abscissa
        return float(np.log(1 / tolerance) / -abscissa) if abscissa < 0 else float("inf")

    @property
    def rows(self) -> dict[str, str]:
        """Names and values of the report: result, settling time, comparison and gains."""
        index = self.network.neuron_index
        rho = [self.gains.rho[index[dual.neuron]] for dual in self.network.cell.duals]
        predicted = self.predicted_settling()
        ended = f": {self.first.ended}" if self.first.ended else ""
        return {
            "scheduled run": f"{_ending(self.first)}{ended}",
            "settling time": f"{predicted * self.spectrum.radius:.0f} tau_min predicted to 1e-6 "
            f"(tau_min: fastest time constant), {predicted:.3g} unit time constants",
            "selected": str(self.best),
            **({"initial state": self.start} if self.start else {}),
            "comparison": self.reason,
            "penalty rho": f"{' to '.join(dict.fromkeys((f'{min(rho):.3g}', f'{max(rho):.3g}')))} "
            f"(threshold rho* = {self.rho_star:.3g})",
            "spectrum": f"radius {self.spectrum.radius:.3g}, abscissa "
            f"{self.spectrum.abscissa:.3g} (per unit time constant)",
        }

    def __str__(self) -> str:
        return "\n".join(f"{name:15}{value}" for name, value in self.rows.items())


def _ending(first: ScheduledRun) -> str:
    ended = "settled" if first.settled and not first.found_by else "did not settle"
    found = f"; {first.found_by} found the optimum" if first.found_by else ""
    return f"{ended} in {first.steps} recurrent steps{found}"


@checked
def design(
    network: Network,
    *,
    preconditioner: Annotated[Kinds, Own()] = ALL_KINDS,
    gain_rule: GainRule | None = None,
    refine: Objective | None = None,
    limit: int = LONGEST_RUN,
    progress: Progress = silent,
    knowledge: Knowledge = NOTHING,
) -> Design:
    """Choose rho, time constants and preconditioner of a network; see `ann_dc.design`.

    Returns a `Design` for every outcome; check ``settled``. Raises `DesignError` if the network has
    no PI duals, its numbers overflow, no kind is allowed, or the only allowed kind has no
    preconditioner. If the first run does not settle, a multilevel preconditioner replaces a grid or
    a tree. ``gain_rule`` also fixes the kind. If ``progress`` raises `Stopped`, the design ends
    with the closed form at the current state. ``knowledge`` contains callbacks of the problem
    behind the network.
    """
    if not network.cell.duals:
        raise DesignError(
            "design: the network has no PI dual neurons, so a penalty rho is not defined; set "
            "the time constants of its neurons manually"
        )
    allowed = _wirable(
        network, _allowed(preconditioner) if gain_rule is None else (gain_rule.kind,)
    )
    with np.errstate(all="ignore"):  # a run that overflows is data
        first = first_run(
            network,
            recipe_of_first_run(gain_rule),
            limit=limit,
            progress=progress,
            knowledge=knowledge,
        )
        settled = SettledPoint(Linearisation(network).at(first.state), first.state)
        if first.found_by:
            first = replace(first, penalty_factor=boost_of(settled))
        choice = FoundChoice if first.found_by else Choice
        freeze = choice(allowed, gain_rule, first, progress, knowledge.cost)
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
    """Return the chosen settled point, all candidates there, and their preset."""
    if freeze.first.ended:
        raise freeze.first.ended
    return freeze.best(settled, limit)


def _allowed(kinds: Kinds) -> tuple[PreconditionerKind, ...]:
    given = several(kinds)
    strange = [kind for kind in given if not isinstance(kind, PreconditionerKind)]
    if strange or not given:
        raise DesignError(
            f"preconditioner: expected one or more of {', '.join(map(str, PreconditionerKind))}, "
            f"got {given!r}"
        )
    return tuple(kind for kind in GAIN_RULES if kind in given)


def _wirable(
    network: Network, kinds: tuple[PreconditionerKind, ...]
) -> tuple[PreconditionerKind, ...]:
    """Return the kinds that a network can have: objectives act beyond every stiffness."""
    if not network.cell.objectives:
        return kinds
    found = tuple(kind for kind in kinds if not kind.is_stiffness)
    if not found:
        raise DesignError(
            "preconditioner: a resistive grid or cyclic reduction couples neighbours, and "
            "objectives act on all stages; "
            "allow PreconditionerKind.MULTILEVEL or PreconditionerKind.DIAGONAL"
        )
    return found


def _verdict(candidate: Candidate) -> str:
    """Return the trial result of a candidate, as text."""
    if candidate.settling < np.inf:
        outcome = f"settles in {candidate.settling:.0f} tau_min"
    elif candidate.settling == np.inf:
        outcome = "does not settle from the initial guess, or later"
    else:
        outcome = "has no trial run" if np.isfinite(candidate.ratio) else "is unstable"
    return f"{candidate.kind.value} {outcome} (stiffness ratio {candidate.ratio:.3g})"


def _frozen(
    settled: SettledPoint, first: ScheduledRun, found: tuple[Candidate, ...], start: str
) -> Design:
    """Return the design with the gains of the best candidate as constants."""
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
