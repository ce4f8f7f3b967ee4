"""Choice of a network for an optimum that a search found, from its own start or from presets."""

from __future__ import annotations

import itertools

import numpy as np

from ann_dc.gain_design.choice import Choice, Frozen, anew, stiffer
from ann_dc.gain_design.freeze import Candidate
from ann_dc.gain_design.rehearsal import HASTY, Patience, at_another
from ann_dc.gain_design.rules.grid_gains import SettledPoint
from ann_dc.gain_design.rules.presets import COARSE, places_of
from ann_dc.network.metrics.contract import Kind

SOON = 600.0
"""Settling, in fastest time constants, below which no other network is asked for."""

GRIDS = (Kind.GRID, Kind.TREE), (1.0, 10.0, 100.0)

ROUNDS = (
    (GRIDS[0], GRIDS[1][:1]),
    (GRIDS[0], GRIDS[1][1:]),
    ((Kind.COUPLED_PYRAMID, Kind.PYRAMID), (1.0,)),
)
"""Kinds of metric, and factors on their penalties, that are compared together, in turn. Time
constants alone, slower than a pyramid and with spectra that take longest, are left out."""


LONGER = Patience(steps=60_000, failures=2)
"""For grids, if nothing settles in a short rehearsal: some need many steps where they are stiff."""

CLEARLY = 1.5
"""Ratio of settling times above which a network begins at a finer preset."""


def _rank(frozen: Frozen) -> tuple[float, float]:
    """Return the rank of the best candidate, behind all others if there is none."""
    return frozen[1][0].rank if frozen[1] else (np.inf, np.inf)


class FoundChoice(Choice):
    """Choice at an optimum at which no run has settled.

    Kinds come in turn, the fastest first, each from the network's own start and from coarse
    presets, until one settles soon. Presets of the whole path come after all of them.
    """

    def best(self, settled: SettledPoint, limit: int) -> Frozen:
        """Compare candidates from the start and from presets; see `Choice.best`."""
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

    def _useful(self) -> tuple[Kind, ...]:
        """Those of the other choices, without time constants alone if there are faster kinds."""
        kinds = super()._useful()
        return tuple(kind for kind in kinds if kind is not Kind.TIME_CONSTANTS) or kinds

    def _with_patience(self, settled: SettledPoint, seen: tuple[Candidate, ...]) -> Frozen:
        """Return grids after longer rehearsals, or stiffer pyramids; else any from the path."""
        grids = tuple(c for c in seen if c.kind in (Kind.GRID, Kind.TREE) and c.ratio < np.inf)
        if grids:
            best = self._from_afar(settled, grids, LONGER)
        else:
            seen = (*seen, *self._rehearsals(settled, stiffer, HASTY))
            best = settled, tuple(sorted(seen, key=lambda candidate: candidate.rank)), ""
        return best if best[1][0].settling < np.inf else self._from_path(settled, seen)

    def _from_path(self, settled: SettledPoint, seen: tuple[Candidate, ...]) -> Frozen:
        """Return candidates from the path, and grids that are made for that start."""
        for words, there in places_of(settled):
            if words not in COARSE:
                grids = self._of(there, *GRIDS)
                again = self._rehearsed(there, (*grids, *anew(seen)))
                if again[0].settling < np.inf:
                    return there, again, words
        return settled, seen, ""

    def _of(
        self, settled: SettledPoint, kinds: tuple[Kind, ...], penalties: tuple[float, ...]
    ) -> tuple[Candidate, ...]:
        """Return candidates of those kinds that are useful."""
        own = [kind for kind in self._useful() if kind in kinds]
        found = ()
        for kind, penalty in itertools.product(own, penalties):
            found = (*found, *self._compared(settled, kind, penalty=penalty, is_brief=True))
        return found

    def _from_afar(
        self, settled: SettledPoint, new: tuple[Candidate, ...], patience: Patience = HASTY
    ) -> Frozen:
        """Return candidates from the start, or from coarse presets if none settles."""
        found = self._rehearsed(settled, new, patience)
        for astray in found if not found[0].settling < np.inf else ():
            other = self._stray_of(settled, astray)
            if other is not None and not self._is_dearer(other, settled):
                there = [at_another(other, candidate) for candidate in found]
                again = self._rehearsed(other, there, patience)
                if again[0].settling < np.inf:
                    return other, again, ""
        best = settled, found, ""
        for words in () if found[0].settling < np.inf else COARSE:
            tried = self._preset(settled, found, patience, (words,))
            if CLEARLY * tried[1][0].rank[0] < best[1][0].rank[0]:
                best = tried
        return best
