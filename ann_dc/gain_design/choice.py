"""Choice of the best network by preconditioner kind and settled point.

A kind near the limit of the stiffness ratio ends the comparison. If networks settle to another
point than the first run, the gains are designed again there. If none settles, steadier gain rules
are tried. If the best network is slow, another first run may find another settled point, or lead to
one.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import TypeAlias

import numpy as np

from ann_dc.analysis.equilibria import equilibrium
from ann_dc.errors import AnnDcError, DesignError, NetworkError
from ann_dc.gain_design.gain_rule import GAIN_RULES, GainRule, recipe_of_first_run, steadier
from ann_dc.gain_design.grid_gains import SettledPoint
from ann_dc.gain_design.knowledge import NOTHING, Cost
from ann_dc.gain_design.rule_presets import COARSE, places_of
from ann_dc.gain_design.scheduled_run import EQUAL_ROWS, ScheduledRun, first_run
from ann_dc.gain_design.trial_run import (
    ELSEWHERE,
    HASTY,
    PATIENT,
    Candidate,
    Patience,
    at_another,
    candidate_of,
    compare,
    distance,
    with_trial_run,
    with_trial_runs,
)
from ann_dc.network.preconditioners.base import PreconditionerKind
from ann_dc.progress import Progress, Stopped

# ---- which network wins: kinds in turn, at the settled point of the first run or anoth

SLOW = 600.0
"""Settling time, in fastest time constants, above which another settled point is searched for."""

_DIFFERENT = 1e-3
"""Distance, relative to the largest primal neuron, above which two settled points differ."""

OTHER_EQUILIBRIA = 4
"""Number of other equilibria that are examined if networks settle there."""

_STIFFER = (10.0, 100.0, 1000.0)
"""Penalty factors tried if no network settles: with low control weights, the closed form's penalty
lets a path leave the constraints.
"""

_MUCH_FASTER = 1.5
"""Speed-up of settling that another settled point must give to be chosen."""

DEARER = 1e-4
"""Cost increase of an admissible other settled point, relative to the cost of the first."""

NEAR_LIMIT = 6.0
"""Stiffness ratio, three times the limit of 2, below which no slower kind is compared."""


Frozen: TypeAlias = tuple[SettledPoint, tuple[Candidate, ...], str]
"""Settled point, its candidates with the best first, and the preset from which the best settles.

An empty preset means the network's initial guess.
"""


@dataclass(frozen=True)
class Choice:
    """Comparison of the allowed preconditioner kinds, until one is near the limit.

    `kinds` are compared in turn. `gain_rule` is fixed by the caller, if any; `cost` returns that of
    a settled point.
    """

    kinds: tuple[PreconditionerKind, ...]
    gain_rule: GainRule | None
    first: ScheduledRun
    progress: Progress
    cost: Cost = NOTHING.cost
    _seen: list[tuple[SettledPoint, Candidate]] = field(
        default_factory=list, init=False, repr=False
    )

    def best(self, settled: SettledPoint, limit: int) -> Frozen:
        """Compare candidates at the end of the first run, elsewhere, and from presets.

        `limit` is the number of steps of another first run. Returns the settled point of the best
        candidate, the candidates with the best first, and the preset from which the best settles
        (empty for the network's initial guess).
        """
        found = self.at(settled)
        if not self.first.settled:
            return settled, found, ""
        other, there = self._followed(settled, found)
        if self._is_dearer(other, settled):
            near, again, start = self._preset(settled, found)
            if again[0].settling < np.inf:
                return near, again, start
        with suppress(Stopped):  # what was compared here stands
            other, there = self._elsewhere(other, there, limit)
        return self._preset(other, there)

    def _is_dearer(self, other: SettledPoint, settled: SettledPoint) -> bool:
        """Return True if another settled point has a higher cost."""
        here = self.cost(settled.state)
        return self.cost(other.state) > here + DEARER * abs(here)

    def at(self, settled: SettledPoint) -> tuple[Candidate, ...]:
        """Return all candidates at a settled point, the best first."""
        found = ()
        for kind in self._useful():
            found = self._tried_out(settled, (*found, *self._compared(settled, kind)))
            if found and found[0].settling < np.inf and found[0].ratio < NEAR_LIMIT:
                break
        if not found:  # the only kind that is allowed has no preconditioner here: let it say why
            return (candidate_of(settled, self.gain_rule or GAIN_RULES[self.kinds[0]], 1.0),)
        return found

    def _tried_out(
        self,
        settled: SettledPoint,
        candidates: Iterable[Candidate],
        patience: Patience = PATIENT,
    ) -> tuple[Candidate, ...]:
        take = self._taker(settled)
        return with_trial_runs(settled, candidates, self.progress, take=take, patience=patience)

    def _taker(self, settled: SettledPoint) -> Callable[[Candidate], None]:
        return lambda candidate: self._seen.append((settled, candidate))

    def best_so_far(self, settled: SettledPoint) -> tuple[SettledPoint, Candidate]:
        """Return the best stable candidate compared before a stop, with its settled point.

        Without a stable candidate, the gains of the first run or of a diagonal rule are used.
        """
        known = [pair for pair in self._seen if np.isfinite(pair[1].ratio)]
        if known:
            return min(known, key=lambda pair: pair[1].rank)
        return settled, self._at_once(settled)

    def _at_once(self, settled: SettledPoint) -> Candidate:
        gain_rule = recipe_of_first_run(self.gain_rule)
        if gain_rule.kind not in self.kinds and PreconditionerKind.DIAGONAL in self.kinds:
            gain_rule = GAIN_RULES[PreconditionerKind.DIAGONAL]
        try:
            return candidate_of(settled, gain_rule, self.first.penalty_factor)
        except DesignError as error:
            raise DesignError(
                f"{settled.network.title}: the gains overflow ({error}); choose units in which "
                "states and controls are near 1"
            ) from error

    def _useful(self) -> tuple[PreconditionerKind, ...]:
        """Return the kinds to compare; stiffnesses require an optimum.

        `RESISTIVE_GRID` replaces `CYCLIC_REDUCTION`.
        """
        kinds = self.kinds
        if PreconditionerKind.RESISTIVE_GRID in kinds:
            kinds = tuple(kind for kind in kinds if kind is not PreconditionerKind.CYCLIC_REDUCTION)
        others = tuple(kind for kind in kinds if not kind.is_stiffness)
        return kinds if self.first.settled else others or (PreconditionerKind.MULTILEVEL,)

    def _compared(
        self,
        settled: SettledPoint,
        kind: PreconditionerKind,
        *,
        penalty: float = 1.0,
        is_brief: bool = False,
    ) -> tuple[Candidate, ...]:
        fixed = (
            self.gain_rule if self.gain_rule is not None and self.gain_rule.kind is kind else None
        )
        return compare(
            settled,
            kind,
            self.first.penalty_factor,
            self.progress,
            gain_rule=fixed,
            penalty=penalty,
            is_brief=is_brief,
            take=self._taker(settled),
        )

    def _followed(
        self, settled: SettledPoint, found: tuple[Candidate, ...]
    ) -> tuple[SettledPoint, tuple[Candidate, ...]]:
        """Repeat the design where networks settle, if none settles at the first point.

        Networks with larger penalties and steadier rules are also tried. Some settle there after
        all; others show another equilibrium.
        """
        if found[0].settling < np.inf:
            return settled, found
        best, there = self._from_other_equilibria(settled, found)
        for gain_rules in (stiffer, steadier):
            if not there and not found[0].settling < np.inf:
                more = self._trial_runs(settled, gain_rules)
                found = tuple(sorted((*found, *more), key=lambda c: c.rank))
                if not found[0].settling < np.inf:
                    best, there = self._from_other_equilibria(settled, found)
        return (best, there) if there else (settled, found)

    def _trial_runs(
        self,
        settled: SettledPoint,
        gain_rules: Callable[[PreconditionerKind], tuple[GainRule, ...]],
        patience: Patience = PATIENT,
    ) -> list[Candidate]:
        """Run trials of closed-form networks of all useful kinds."""
        trial_runs = []
        for kind in (kind for kind in self._useful() if not kind.is_stiffness):
            for gain_rule in gain_rules(kind):
                candidate = candidate_of(settled, gain_rule, self.first.penalty_factor)
                if np.isfinite(candidate.ratio):
                    self.progress(f"candidates: another {kind.value}")
                    tried = with_trial_run(
                        settled, candidate, progress=self.progress, patience=patience
                    )
                    trial_runs.append(tried)
        return trial_runs

    def _preset(
        self,
        settled: SettledPoint,
        found: tuple[Candidate, ...],
        patience: Patience = PATIENT,
        names: tuple[str, ...] = (),
    ) -> Frozen:
        """Run the candidates from presets, all or selected by name, if none settles yet.

        Returns the settled point of a network with that initial guess, the candidates, and the
        preset (empty for the network's initial guess).
        """
        if found[0].settling < np.inf:
            return settled, found, ""
        for words, there in places_of(settled):
            if names and words not in names:
                continue
            again = self._tried_out(there, anew(found), patience)
            if again[0].settling < np.inf:
                return there, again, words
        return settled, found, ""

    def _from_other_equilibria(
        self, settled: SettledPoint, found: tuple[Candidate, ...]
    ) -> tuple[SettledPoint, tuple[Candidate, ...]]:
        """Return the other equilibrium at which a network settles fastest, if any."""
        seen: list[SettledPoint] = []
        best, settles = settled, ()
        for other_equilibrium in found:
            other = self._other_equilibrium_of(settled, other_equilibrium)
            if other is None or any(distance(o, other.state) < ELSEWHERE for o in seen):
                continue
            seen.append(other)
            own = at_another(other, other_equilibrium)
            if np.isfinite(own.ratio):
                own = with_trial_run(other, own, progress=self.progress)
            there = tuple(sorted((*self._at_another(other), own), key=lambda c: c.rank))
            if there[0].rank < (settles[0].rank if settles else (np.inf, 0.0)):
                best, settles = other, there
            if len(seen) == OTHER_EQUILIBRIA:
                break
        return best, settles

    def _other_equilibrium_of(
        self, settled: SettledPoint, candidate: Candidate
    ) -> SettledPoint | None:
        """Return the other equilibrium at which a candidate settled, or None."""
        if candidate.other_equilibrium is None:
            return None
        try:
            state = equilibrium(settled.network, candidate.other_equilibrium)
        except NetworkError:
            return None
        return SettledPoint(settled.linear.at(state), state)

    def _at_another(self, other: SettledPoint) -> tuple[Candidate, ...]:
        """Return candidates at another point; empty if no preconditioner exists there."""
        try:
            return self.at(other)
        except Stopped:
            raise
        except AnnDcError:
            return ()

    def _elsewhere(
        self, settled: SettledPoint, found: tuple[Candidate, ...], limit: int
    ) -> tuple[SettledPoint, tuple[Candidate, ...]]:
        """Repeat the design where a run with equal weights ends, if much faster there.

        A point of higher cost is rejected unless nothing settles here.
        """
        if found[0].rank[0] < SLOW or self.first.steps < EQUAL_ROWS:
            return settled, found
        second = first_run(
            settled.network,
            recipe_of_first_run(self.gain_rule),
            limit=limit,
            equal_rows=limit,
            progress=self.progress,
        )
        if not second.settled or distance(settled, second.state) < _DIFFERENT:
            return settled, found
        other, there = replace(self, first=second)._led_to(settled)
        if not there or found[0].rank[0] <= _MUCH_FASTER * there[0].rank[0]:
            return settled, found
        is_dearer = found[0].settling < np.inf and self._is_dearer(other, settled)
        return (settled, found) if is_dearer else (other, there)

    def _led_to(self, settled: SettledPoint) -> tuple[SettledPoint, tuple[Candidate, ...]]:
        """Repeat the design at the end of this first run; empty without a preconditioner."""
        other = SettledPoint(settled.linear.at(self.first.state), self.first.state)
        there = self._at_another(other)
        try:
            return self._followed(other, there) if there else (other, there)
        except Stopped:
            raise
        except AnnDcError:
            return other, there


def anew(candidates: Iterable[Candidate]) -> list[Candidate]:
    """Return candidates without their trial results."""
    return [
        replace(candidate, settling=float("nan"), other_equilibrium=None)
        for candidate in candidates
    ]


def stiffer(kind: PreconditionerKind) -> tuple[GainRule, ...]:
    """Return gain rules of a kind with larger penalties."""
    own = GAIN_RULES[kind]
    return tuple(replace(own, penalty=factor * own.penalty) for factor in _STIFFER)


# ---- choice of a network for an optimum that a search found, from its own start or from presets

SOON = 600.0
"""Settling time, in fastest time constants, below which the comparison ends."""

_GRIDS = (
    (PreconditionerKind.RESISTIVE_GRID, PreconditionerKind.CYCLIC_REDUCTION),
    (1.0, 10.0, 100.0),
)

ROUNDS = (
    (_GRIDS[0], _GRIDS[1][:1]),
    (_GRIDS[0], _GRIDS[1][1:]),
    ((PreconditionerKind.COUPLED_MULTILEVEL, PreconditionerKind.MULTILEVEL), (1.0,)),
)
"""Kinds and penalty factors compared together, in turn, without the slower diagonal kind, whose
spectra take longest.
"""


LONGER = Patience(steps=60_000, failures=2)
"""Patience for grids if nothing settles in a short trial run: stiff grids need many steps."""

_CLEARLY = 1.5
"""Ratio of settling times above which a finer preset is preferred."""


def _rank(frozen: Frozen) -> tuple[float, float]:
    """Return the rank of the best candidate, worst if there is none."""
    return frozen[1][0].rank if frozen[1] else (np.inf, np.inf)


class FoundChoice(Choice):
    """Choice at an optimum at which no run has settled.

    Kinds are tried from the fastest on, each from the network's initial guess and from coarse
    presets, until one settles soon. Presets of the whole path are tried last.
    """

    def best(self, settled: SettledPoint, limit: int) -> Frozen:
        """Compare candidates from the initial guess and from presets; see `Choice.best`."""
        seen, best = (), (settled, (), "")
        for kinds, penalties in ROUNDS:
            new = self._of(settled, kinds, penalties)
            if not new:
                continue
            seen = (*seen, *new)
            tried = self._from_afar(settled, new)
            best = min(tried, best, key=_rank)
            if _rank(best)[0] < SOON:
                break
        if not any(candidate.ratio < np.inf for candidate in seen):
            return self._preset(settled, self.at(settled), HASTY)
        if not _rank(best)[0] < np.inf:
            best = self._with_patience(settled, seen)
        there, found, start = best
        others = (
            candidate for candidate in seen if candidate.gains not in {c.gains for c in found}
        )
        return there, (*found, *others), start

    def _useful(self) -> tuple[PreconditionerKind, ...]:
        """Return the kinds of `Choice` without the diagonal kind if there are faster ones."""
        kinds = super()._useful()
        return tuple(kind for kind in kinds if kind is not PreconditionerKind.DIAGONAL) or kinds

    def _with_patience(self, settled: SettledPoint, seen: tuple[Candidate, ...]) -> Frozen:
        """Return grids after longer trials or stiffer multilevel rules, or from the path."""
        grids = tuple(c for c in seen if c.kind.is_stiffness and c.ratio < np.inf)
        if grids:
            best = self._from_afar(settled, grids, LONGER)
        else:
            seen = (*seen, *self._trial_runs(settled, stiffer, HASTY))
            best = settled, tuple(sorted(seen, key=lambda candidate: candidate.rank)), ""
        return best if best[1][0].settling < np.inf else self._from_path(settled, seen)

    def _from_path(self, settled: SettledPoint, seen: tuple[Candidate, ...]) -> Frozen:
        """Return candidates from the path, and grids designed for that initial guess."""
        for words, there in places_of(settled):
            if words not in COARSE:
                grids = self._of(there, *_GRIDS)
                again = self._tried_out(there, (*grids, *anew(seen)))
                if again[0].settling < np.inf:
                    return there, again, words
        return settled, seen, ""

    def _of(
        self,
        settled: SettledPoint,
        kinds: tuple[PreconditionerKind, ...],
        penalties: tuple[float, ...],
    ) -> tuple[Candidate, ...]:
        """Return candidates of the given kinds that are useful."""
        own = [kind for kind in self._useful() if kind in kinds]
        found = ()
        for kind, penalty in itertools.product(own, penalties):
            found = (*found, *self._compared(settled, kind, penalty=penalty, is_brief=True))
        return found

    def _from_afar(
        self, settled: SettledPoint, new: tuple[Candidate, ...], patience: Patience = HASTY
    ) -> Frozen:
        """Return candidates from the initial guess, or from presets if none settles."""
        found = self._tried_out(settled, new, patience)
        for other_equilibrium in found if not found[0].settling < np.inf else ():
            other = self._other_equilibrium_of(settled, other_equilibrium)
            if other is not None and not self._is_dearer(other, settled):
                there = [at_another(other, candidate) for candidate in found]
                again = self._tried_out(other, there, patience)
                if again[0].settling < np.inf:
                    return other, again, ""
        best = settled, found, ""
        for words in () if found[0].settling < np.inf else COARSE:
            tried = self._preset(settled, found, patience, (words,))
            if _CLEARLY * tried[1][0].rank[0] < best[1][0].rank[0]:
                best = tried
        return best
