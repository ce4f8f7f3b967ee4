"""Figures of the example without obstacles: corrected and printed equations."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from ann_dc.paper.paths import Path, path_of, rolled_out, run_away
from ann_dc.plotting.paper.plane import Drawn, Panel, plane
from ann_dc.plotting.paper.stages import controls_over_stages
from ann_dc.plotting.style import BLUE, GREY, INK, ORANGE, SKY, VERMILION, caption, with_unit
from ann_dc.solution.solution import Solution
from ann_dc.validation import checked

FADING = (SKY, ORANGE, GREY)
HOLDS, PRINTED = "what holds", "what the printed equations give"


@checked
def free_paths(optimum: Solution, straight: Solution, letter: Solution) -> Figure:
    """Plot the path without obstacles next to two paths of the printed equations.

    Parameters
    ----------
    optimum : Solution
        Solution of the corrected equations.
    straight : Solution
        Solution without dB/dq (erratum S3).
    letter : Solution
        Run of (16) and (17) as printed.

    Returns
    -------
    matplotlib.figure.Figure

    Examples
    --------
    >>> import ann_dc
    >>> found = ann_dc.solve(ann_dc.plants.car())
    >>> len(free_paths(found, found, found).axes)
    2

    References
    ----------
    Paper, Figure 4.
    """
    problem = optimum.problem
    names = [str(s) for s in problem.states]
    x, y = names.index("x"), names.index("y")
    ends = np.array([problem.q_0, problem.q_d], float)
    q_0, q_d = ((float(end[x]), float(end[y])) for end in ends)
    holds, printed = _paths(optimum, straight, letter)
    return plane(
        [_panel(HOLDS, holds, _position), _panel(PRINTED, printed, _position)],
        start=q_0,
        target=q_d,
        unit=problem.unit("x"),
        title=f"Paths without obstacles, {caption(problem)}",
    )


@checked
def free_controls(optimum: Solution, straight: Solution, letter: Solution) -> Figure:
    """Plot the controls of the paths in `free_paths`.

    Parameters
    ----------
    optimum, straight, letter : Solution
        Solutions as in `free_paths`.

    Returns
    -------
    matplotlib.figure.Figure

    Examples
    --------
    >>> import ann_dc
    >>> found = ann_dc.solve(ann_dc.plants.car())
    >>> len(free_controls(found, found, found).axes)
    4

    References
    ----------
    Paper, Figure 5.
    """
    problem = optimum.problem
    holds, printed = _paths(optimum, straight, letter)
    controls = [str(u) for u in problem.controls]
    labels = [with_unit(f"u_{i + 1} = {u}", problem.unit(u)) for i, u in enumerate(controls)]
    return controls_over_stages(
        [
            _panel(HOLDS, holds[:1], _controls),
            _panel(PRINTED, [p for p in printed if not p[2]], _controls),
        ],
        labels=labels,
        title=f"Controls without obstacles, {caption(problem)}",
    )


Named = tuple[Path, str, bool]
"""Path, its colour, and True if it is the simulated path of the controls."""


def _paths(
    optimum: Solution, straight: Solution, letter: Solution
) -> tuple[list[Named], list[Named]]:
    holds = [
        (path_of(optimum, "T_0, the optimum"), BLUE, False),
        (rolled_out(optimum, "where its controls lead"), INK, True),
    ]
    printed = [
        (path_of(straight, "without dB/dq (S3)"), VERMILION, False),
        (rolled_out(straight, "where its controls lead"), INK, True),
    ]
    away = zip(run_away(letter), FADING)
    return holds, printed + [(_named(path), colour, False) for path, colour in away]


def _named(path: Path) -> Path:
    return Path(name=f"(16), (17) {path.name}", x=path.x, y=path.y, controls=path.controls)


def _position(path: Path) -> np.ndarray:
    return np.stack([path.x, path.y])


def _controls(path: Path) -> np.ndarray:
    return path.controls


def _panel(heading: str, paths: Sequence[Named], rows) -> Panel:
    drawn = [
        Drawn(name=path.name, rows=rows(path), colour=colour, dashed=dashed)
        for path, colour, dashed in paths
    ]
    return Panel(heading=heading, drawn=drawn)
