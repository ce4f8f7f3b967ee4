"""Figures 4 and 5: paths among obstacles and their controls, in three variants."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from matplotlib.figure import Figure

from ann_dc.paper.around import APART, RADIUS, Around, obstacles, whole
from ann_dc.plotting.paper.plane import Disc, Drawn, Panel, plane
from ann_dc.plotting.paper.stages import controls_over_stages
from ann_dc.plotting.style import BLUE, GREEN, INK, ORANGE, VERMILION, with_unit
from ann_dc.validation import checked

COLUMNS = 3
"""Panels of a case: as printed, with segments (legs), with discs."""
FREE = "T_0, planned without obstacles"
PLANNED = "T_0, T_1, ... as far as they are driven (IV.C)"
LEAP = "to q_obs + delta: printed without a plan"
LEG = "legs to q_obs + delta, planned too"
DRIVEN = "plans and legs, as they are driven"
CONSTRAINED = "one network, obstacles as constraints"


@checked
def figure_4(cases: Sequence[Around]) -> Figure:
    """Plot the paths among obstacles: as printed, with segments, and with discs.

    See Figure 4 and section IV.C of the paper.

    Examples
    --------
    >>> from ann_dc.paper import around, iterations
    >>> cases = [around(plans, problem) for plans in iterations().cases]  # doctest: +SKIP
    >>> figure = figure_4(cases)  # doctest: +SKIP
    """
    problem = cases[0].discs.problem
    (x_0, y_0), (x_d, y_d) = (end[:2].tolist() for end in problem.ends)
    return plane(
        [panel for case in cases for panel in _panels(case, _paths(case))],
        start=(x_0, y_0),
        target=(x_d, y_d),
        unit=problem.unit("x"),
        title=f"Figure 4. Paths among obstacles of radius {RADIUS:g} m; room: from a segment to an "
        f"edge; constraints keep nodes and points between them {APART:g} m from centres",
        columns=COLUMNS,
    )


@checked
def figure_5(cases: Sequence[Around]) -> Figure:
    """Plot the controls of the paths in `figure_4` (Figure 5 of the paper).

    Examples
    --------
    >>> from ann_dc.paper import around, iterations
    >>> cases = [around(plans, problem) for plans in iterations().cases]  # doctest: +SKIP
    >>> figure = figure_5(cases)  # doctest: +SKIP
    """
    problem = cases[0].discs.problem
    names = [str(u) for u in problem.controls]
    return controls_over_stages(
        [panel for case in cases for panel in _panels(case, _controls(case))],
        labels=[with_unit(f"u_{i + 1} = {u}", problem.unit(u)) for i, u in enumerate(names)],
        title=f"Figure 5. Controls of the paths of Figure 4, stages of {problem.dt:g} s",
        columns=COLUMNS,
    )


def _panels(case: Around, drawn: Sequence[Sequence[Drawn]]) -> list[Panel]:
    """Return the panels of a case: as printed, with segments, with discs."""
    name, certificate = case.plans.case.name, case.discs.certificate
    told = "certified" if case.discs.certified else "not certified"
    legs, constrained = (f"room {case.room(way):.3f} m" for way in case.ways.values())
    headings = (
        f"{name}, as printed\n{case.leap:.2f} m of the way in no plan",
        f"{name}, legs planned too\n{legs}",
        f"{name}, as constraints\n{constrained}, E = {certificate.objective:.2f}, {told}",
    )
    discs = [Disc(x=float(x), y=float(y), radius=RADIUS) for x, y in obstacles(case.plans)]
    return [Panel(heading=h, drawn=d, discs=discs) for h, d in zip(headings, drawn)]


def _paths(case: Around) -> tuple[Sequence[Drawn], ...]:
    free = Drawn(name=FREE, rows=case.plans.states[0, :2], colour=INK, dashed=True)
    pieces = [piece.q[:2] for piece in case.printed]
    planned = Drawn(name=PLANNED, rows=_apart(pieces), colour=BLUE)
    leaps = [np.stack([a[:, -1], b[:, 0]], axis=1) for a, b in pairwise(pieces)]
    legs = [whole(leg).q[:2] for leg in case.legs]
    return (
        (free, planned, Drawn(name=LEAP, rows=_apart(leaps), colour=VERMILION, dashed=True)),
        (free, planned, Drawn(name=LEG, rows=_apart(legs), colour=ORANGE)),
        (free, Drawn(name=CONSTRAINED, rows=case.ways["discs"].q[:2], colour=GREEN)),
    )


def _controls(case: Around) -> tuple[Sequence[Drawn], ...]:
    free = Drawn(name=FREE, rows=case.plans.controls[0], colour=INK, dashed=True)
    pieces = [piece.u for piece in case.printed]
    legs, constrained = case.ways.values()
    return (
        (free, Drawn(name=PLANNED, rows=_apart(pieces), colour=BLUE)),
        (free, Drawn(name=DRIVEN, rows=legs.u, colour=ORANGE)),
        (free, Drawn(name=CONSTRAINED, rows=constrained.u, colour=GREEN)),
    )


def _apart(pieces: Sequence[np.ndarray]) -> np.ndarray:
    """Concatenate pieces (R, K) with gaps between them."""
    gap = np.full((len(pieces[0]), 1), np.nan)
    return np.hstack([part for piece in pieces for part in (piece, gap)][:-1])
