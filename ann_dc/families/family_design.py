"""Design for a family of inputs: one frozen network that settles for (nearly) all of them.

1. Settled points of a space-filling sample of the inputs, each from its own straight line.
2. Candidates of every kind of metric, read off the first point or off the mean of all of them,
   with several penalties, path terms and rates of the multipliers.
3. The race (`race`): rehearsals from the starts of more and more inputs.
4. Validation (`validation`) on inputs that no choice has seen.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np

from ann_dc.analysis.linearisation import Linearisation
from ann_dc.decomposition.equations import decompose
from ann_dc.errors import DesignError
from ann_dc.families.family import Family, Over, Sample, family_of
from ann_dc.families.race import ROUNDS, Runner, entered, raced
from ann_dc.families.validation import Validation, told, validated
from ann_dc.gain_design.rules.gains import Gains, apply_gains
from ann_dc.gain_design.rules.grid_gains import SettledPoint
from ann_dc.gain_design.rules.recipe import RECIPES, WITH_COORDINATORS
from ann_dc.gain_design.scheduled_run import first_run
from ann_dc.hints.checked import checked
from ann_dc.hints.values import Own
from ann_dc.hints.words import such_as
from ann_dc.network.metrics.contract import ALL_KINDS, Kind
from ann_dc.network.network import Network
from ann_dc.optimality.prospects.prospect import Prospect
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.progress import Progress, silent
from ann_dc.solution.knowledge import knowledge_of
from ann_dc.synthesis.synthesis import synthesize

POINTS = 16
"""Inputs whose settled points the gains are read off."""
GOAL = 0.995
"""Share of the race's inputs from which on no slower kind of metric is raced."""
LONGEST_RUN = 20_000
"""Steps of a first run of one of the inputs."""
HELD_OUT = 1000
"""Inputs of the validation."""


@such_as("ann_dc.design(problem, over=...)")
@checked
@dataclass(frozen=True, kw_only=True, eq=False)
class FamilyDesign:
    """One network for a family of inputs, and what it was seen to do.

    Attributes
    ----------
    network : Network
        Frozen; it knows the ranges for which it was designed.
    family : Family
    gains : Gains
    winner : Runner
        The candidate that won, with its settling on the inputs of the race.
    points : int
        Inputs at whose settled points gains were read off.
    validation : Validation
        On held-out inputs; of a listed family, on the list itself.

    Examples
    --------
    >>> from ann_dc import plants
    >>> listed = [{"q_0.x": -0.5}, {"q_0.x": 0.5}]
    >>> designed = design_family(plants.double_integrator(N=3), listed)
    >>> len(designed.validation), designed.validation.share
    (2, 1.0)
    """

    network: Network
    family: Family
    gains: Gains
    winner: Runner
    points: int
    validation: Validation

    def __str__(self) -> str:
        ranges = ", ".join(
            f"{name} from {low:.4g} to {high:.4g}"
            for name, (low, high) in self.family.ranges.items()
        )
        return "\n".join(
            [
                f"family                 {ranges}",
                f"network                {self.winner}",
                f"read off               {self.points} settled points",
                str(self.validation),
            ]
        )


@checked
def design_family(
    problem: OptimalControlProblem,
    over: Annotated[Over, Own()],
    *,
    kinds: Iterable[Kind] = ALL_KINDS,
    held_out: int = HELD_OUT,
    seed: int = 0,
    progress: Progress = silent,
) -> FamilyDesign:
    """Choose constants with which one network settles for a whole family of inputs.

    Parameters
    ----------
    problem : OptimalControlProblem
        Its own inputs count as one of the family; they set the scales of the network.
    over : Over
        The family; see `family_of`.
    kinds : iterable of Kind
        The metrics among which to choose; all by default.
    held_out : int
        Inputs of the validation.
    seed : int
        Of all samples: the same seed gives the same network.
    progress : Progress
        Takes one line at a time on what is going on.

    Returns
    -------
    FamilyDesign

    Raises
    ------
    DesignError
        If no input of the family leads to a settled point, or no candidate holds those found.
    ProblemError
        If a range is empty, or a sample holds a value that is no number.
    UnknownNameError
        If the network has no such input.

    Examples
    --------
    >>> from ann_dc import plants
    >>> designed = design_family(
    ...     plants.double_integrator(N=3), {"q_d.x": (0.5, 2.0)}, held_out=20)
    >>> designed.validation.share
    1.0
    """
    if held_out < 1:
        raise DesignError(f"held_out: expected a number of inputs from 1 on, got {held_out!r}")
    family = family_of(problem, synthesize(decompose(problem)), over)
    points, boost = _settled_points(family, seed, progress)
    networks = [
        family.network_of(sample) for sample in family.samples(ROUNDS[-1][0], seed=seed + 1)
    ]
    winner = _winner(points, boost, networks, tuple(kinds), progress)
    network = replace(apply_gains(family.network, winner.gains), ranges=dict(family.ranges))
    frozen = replace(family, network=network)
    seen = family.held_out(held_out, seed=seed + 2)
    judged = replace(frozen, network=replace(network, ranges={}))  # a sampler may go beyond
    return FamilyDesign(
        network=network,
        family=frozen,
        gains=winner.gains,
        winner=winner,
        points=len(points),
        validation=validated(judged, winner.pace, seen, progress),
    )


def _settled_points(
    family: Family, seed: int, progress: Progress
) -> tuple[list[SettledPoint], float]:
    """Settled points of the problem itself and of a few inputs; the largest boost that it took."""
    samples: list[Sample] = [{}, *family.samples(POINTS - 1, seed=seed)[: POINTS - 1]]
    points, boost, why = [], 1.0, ""
    with np.errstate(all="ignore"):  # a run that overflows is data
        for number, sample in enumerate(samples, 1):
            progress(f"settled point {number} of {len(samples)}")
            network = family.network_of(sample) if sample else family.network
            prospect = Prospect(problem=family.problem_of(sample), progress=progress)
            found = first_run(
                network,
                WITH_COORDINATORS,
                limit=LONGEST_RUN,
                progress=progress,
                knowledge=knowledge_of(prospect, network),
            )
            if found.ended is not None:
                why = f"{told(sample)}: {found.ended}" if sample else str(found.ended)
            elif found.settled:
                points.append(SettledPoint(Linearisation(network).at(found.state), found.state))
                boost = max(boost, found.boost)
    if not points:
        raise DesignError(
            f"over: none of {len(samples)} inputs leads to a settled point "
            f"({why or told(samples[-1])}); is there a feasible one in these ranges?"
        )
    return points, boost


def _winner(
    points: list[SettledPoint],
    boost: float,
    networks: list[Network],
    kinds: tuple[Kind, ...],
    progress: Progress,
) -> Runner:
    """The best of all kinds, fastest kind first, until one reaches the goal."""
    best: Runner | None = None
    with np.errstate(all="ignore"):
        for kind in (kind for kind in RECIPES if kind in kinds):
            if kind is Kind.TREE and Kind.GRID in kinds:  # the same metric
                continue
            runners = entered(points, kind, boost)
            if runners:
                raced_best = raced(runners, networks, progress)
                best = raced_best if best is None else min(best, raced_best, key=lambda r: r.rank)
            if best is not None and best.share >= GOAL:
                break
    if best is None:
        raise DesignError(
            "over: no network holds the settled points of these ranges at once; narrow them, or "
            "allow other kinds of metric"
        )
    return best
