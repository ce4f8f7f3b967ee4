"""Panels of Figures 4 and 5 with obstacles: what IV.C drives of its plans, as printed."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from ann_dc.hints.checked import checked
from ann_dc.paper.around import driven, obstacles
from ann_dc.paper.replans import Plans
from ann_dc.plotting.paper.plane import Disc, Drawn, Panel
from ann_dc.plotting.style import BLUE, INK, VERMILION

RADIUS = 0.25
"""Of the obstacles, in m; the paper gives none."""
WITHOUT, DRIVEN = "T_0, which knows no obstacle", "driven: T_0, T_1, ... (IV.C)"
LEAP = "no leg to q_obs + δ, as printed"


@checked
def path_around(plans: Plans) -> Panel:
    """The path of a case for `figure_4`: pieces of plans, and leaps to where the next one begins.

    Parameters
    ----------
    plans : Plans

    Examples
    --------
    >>> from ann_dc.paper import iterations
    >>> panel = path_around(iterations().cases[0])  # doctest: +SKIP
    """
    pieces = [piece.q[:2] for piece in driven(plans)]
    leaps = [np.stack([a[:, -1], b[:, 0]], axis=1) for a, b in pairwise(pieces)]
    return Panel(
        heading=plans.case.name,
        drawn=[
            Drawn(name=WITHOUT, rows=plans.states[0, :2], colour=INK, dashed=True),
            Drawn(name=DRIVEN, rows=_apart(pieces), colour=BLUE),
            Drawn(name=LEAP, rows=_apart(leaps), colour=VERMILION, dashed=True),
        ],
        discs=[Disc(x=float(x), y=float(y), radius=RADIUS) for x, y in obstacles(plans)],
    )


@checked
def controls_around(plans: Plans) -> Panel:
    """The controls that go with `path_around`, for `figure_5`; a gap of a stage is a leap.

    Parameters
    ----------
    plans : Plans

    Examples
    --------
    >>> from ann_dc.paper import iterations
    >>> panel = controls_around(iterations().cases[0])  # doctest: +SKIP
    """
    pieces = [piece.u for piece in driven(plans)]
    return Panel(
        heading=plans.case.name,
        drawn=[
            Drawn(name=WITHOUT, rows=plans.controls[0], colour=INK, dashed=True),
            Drawn(name=DRIVEN, rows=_apart(pieces), colour=BLUE),
        ],
    )


def _apart(pieces: list[np.ndarray]) -> np.ndarray:
    """Pieces (R, K) behind each other, with gaps between them."""
    gap = np.full((len(pieces[0]), 1), np.nan)
    return np.hstack([part for piece in pieces for part in (piece, gap)][:-1])
