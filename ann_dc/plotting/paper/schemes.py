"""Figures 1 to 3: robot, decomposition into stages, exchange of the two levels."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Arc, FancyBboxPatch, Polygon

from ann_dc.plotting import style
from ann_dc.plotting.style import BLUE, GREEN, GREY, INK, ORANGE, VERMILION
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.validation import Finite, Positive, checked

WHEEL = 0.3, 0.09
"""Length and width of a wheel relative to the wheel base."""
TRACK = 0.5
"""Distance between the wheels of an axle relative to the wheel base."""
BOX = "#EEF3F7"
COLUMNS = 0.0, 3.4, 6.8
"""Positions of the first, a middle and the last stage."""


@checked
def figure_1(*, D: Positive = 1.0, phi: Finite = 0.5, varphi: Finite = 0.45) -> Figure:
    """Draw the four-wheel robot with its coordinates.

    `D` is the axle distance in m; `phi` and `varphi` are heading and steering angle in rad. See
    Figure 1 and equation (1) of the paper.
    """
    figure = style.new_figure(5.2, 4.4)
    axes = figure.subplots()
    ahead = np.array([np.cos(phi), np.sin(phi)])
    aside = np.array([-ahead[1], ahead[0]])
    rear, front = np.zeros(2), D * ahead
    for axle, angle in ((rear, phi), (front, phi + varphi)):
        ends = [axle + side * TRACK / 2 * D * aside for side in (-1, 1)]
        axes.plot(*np.array(ends).T, color=INK, lw=1.5)
        for end in ends:
            axes.add_patch(_wheel(end, angle, D))
    axes.plot(*np.array([rear, front]).T, color=INK, lw=2.0)
    axes.plot(*rear, "o", color=VERMILION, ms=6)
    _dashed(axes, rear, (0.75 * D, 0.0))
    _dashed(axes, front, 0.56 * D * ahead)
    turned = np.array([np.cos(phi + varphi), np.sin(phi + varphi)])
    _dashed(axes, front, 0.7 * D * turned)
    arrow(axes, rear, rear + 0.45 * D * ahead, BLUE)
    _angle(axes, rear, 0.5 * D, (0.0, phi), "phi")
    _angle(axes, front, 0.5 * D, (phi, phi + varphi), "varphi")
    _label(axes, rear - 0.12 * D * (ahead - aside), "(x, y)", INK, ha="right", va="center")
    _label(axes, 0.3 * D * ahead - 0.12 * D * aside, "nu", BLUE, ha="center")
    turning = np.array([np.cos(phi + varphi + 0.3), np.sin(phi + varphi + 0.3)])
    turn = {"arrowstyle": "-|>", "color": GREEN, "lw": 1.3, "connectionstyle": "arc3,rad=0.15"}
    ends = (front + 0.62 * D * turned, front + 0.62 * D * turning)
    axes.annotate("", tuple(ends[1]), tuple(ends[0]), arrowprops=turn)
    _label(axes, front + 0.74 * D * turned, "eta: rate of varphi", GREEN, va="bottom")
    _label(axes, 0.62 * D * ahead + 0.08 * D * aside, f"D = {D:g} m", INK, ha="right", va="bottom")
    axes.set_xlim(-0.6 * D, 2.2 * D)
    axes.set_ylim(-0.45 * D, 1.35 * D)
    axes.set_aspect("equal")
    axes.axis("off")
    style.headline(figure, "Figure 1. Four-wheel robot: q = (x, y, phi, varphi), u = (nu, eta)")
    return figure


@checked
def figure_2(problem: OptimalControlProblem) -> Figure:
    """Draw the stages of a problem in series with states, controls and outputs.

    See Figure 2 and equation (8) of the paper.

    Examples
    --------
    >>> from ann_dc import plants
    >>> len(figure_2(plants.car()).axes)
    1
    """
    figure, axes = _board(10.4, 3.2)
    last = problem.horizon - 1
    for place, k in zip(COLUMNS, ("0", "k", str(last))):
        box(axes, place, 0.0, f"$t_{{{k}}} = f(q_{{{k}}}, u_{{{k}}})$")
        arrow(axes, (place + 1.0, 1.45), (place + 1.0, 0.85), BLUE)
        axes.text(place + 1.0, 1.55, f"$u_{{{k}}}$", ha="center", va="bottom", color=BLUE)
    arrow(axes, (-0.9, 0.4), (0.0, 0.4), INK)
    axes.text(-0.95, 0.4, "$q_0$ given", ha="right", va="center")
    for place, (out, into) in zip(COLUMNS, (("0", "k"), ("k", str(last)))):
        arrow(axes, (place + 2.0, 0.4), (place + 3.4, 0.4), INK, dashed=True)
        axes.text(place + 2.1, 0.48, f"$t_{{{out}}}$", va="bottom")
        before = "k-1" if into == "k" else str(last - 1)
        axes.text(place + 2.7, 0.1, f"$q_{{{into}}} = t_{{{before}}}$", ha="center", va="top")
    arrow(axes, (COLUMNS[-1] + 2.0, 0.4), (COLUMNS[-1] + 2.9, 0.4), INK)
    end = "$q_d$" if any(problem.fixed) else "free terminal state"
    axes.text(COLUMNS[-1] + 2.95, 0.4, f"$t_{{{last}}}$ = {end}", va="center")
    axes.set_xlim(-2.4, COLUMNS[-1] + 4.6)
    axes.set_ylim(-0.6, 2.0)
    states, controls = (", ".join(map(str, of)) for of in (problem.states, problem.controls))
    named = f"q = ({states}), u = ({controls})"
    style.headline(
        figure, f"Figure 2. Decomposition of {problem.name} into {last + 1} stages: {named}"
    )
    return figure


@checked
def figure_3(problem: OptimalControlProblem) -> Figure:
    """Draw the exchange between the two levels in an outer iteration.

    See Figure 3 and the corrected equations (16), (17) of the paper.

    Examples
    --------
    >>> from ann_dc import plants
    >>> len(figure_3(plants.car()).axes)
    1
    """
    figure, axes = _board(10.4, 4.4)
    last = problem.horizon - 1
    width = COLUMNS[-1] + 2.0
    box(axes, 0.0, 2.6, "", width=width, height=1.0)
    axes.text(width / 2, 3.36, "upper level: coordinator, (14), (15), (17) corrected", ha="center")
    axes.text(
        width / 2, 2.9, r"$t_k \leftarrow t_k + \lambda_t(\mu_k + \beta_{k+1})$"
        r"$\qquad \beta_k \leftarrow \beta_k + \lambda_\beta(q_k - t_{k-1})$", ha="center",
    )  # fmt: skip
    for place, k in zip(COLUMNS, ("0", "k", str(last))):
        box(axes, place, 0.0, f"stage {k}\n$q_{{{k}}}, u_{{{k}}}, \\mu_{{{k}}}$")
        arrow(axes, (place + 0.6, 2.6), (place + 0.6, 0.85), ORANGE)
        arrow(axes, (place + 1.4, 0.85), (place + 1.4, 2.6), BLUE)
        reported = {"0": "$t_0$", "k": r"$t_k, \beta_k$"}.get(k, rf"$\beta_{{{k}}}$")
        axes.text(place + 0.5, 1.72, reported, ha="right", color=ORANGE)
        axes.text(place + 1.5, 1.72, f"$q_{{{k}}}, \\mu_{{{k}}}$", color=BLUE)
    for place in COLUMNS[:-1]:
        axes.text(place + 2.7, 0.4, "...", ha="center", va="center", fontsize=14)
    axes.text(
        width / 2, -0.3, "lower level: every stage solves (11)-(13) separately, (16)", ha="center",
        va="top",
    )  # fmt: skip
    axes.set_xlim(-1.0, width + 1.0)
    axes.set_ylim(-0.8, 3.9)
    style.headline(figure, f"Figure 3. Information transfer between the two levels, {problem.name}")
    return figure


def _board(width: float, height: float) -> tuple[Figure, Axes]:
    figure = style.new_figure(width, height)
    axes = figure.subplots()
    axes.axis("off")
    return figure, axes


def box(axes: Axes, x: float, y: float, text: str, width: float = 2.0, height: float = 0.8) -> None:
    """Draw a box with a text at its centre; ``x``, ``y`` is its lower left corner."""
    shape = "round,pad=0,rounding_size=0.08"
    patch = FancyBboxPatch((x, y), width, height, boxstyle=shape, fc=BOX, ec=INK, lw=1.0)
    axes.add_patch(patch)
    axes.text(x + width / 2, y + height / 2, text, ha="center", va="center")


def arrow(axes: Axes, start, end, colour: str, dashed: bool = False) -> None:
    """Draw an arrow between two points."""
    line = {"arrowstyle": "-|>", "color": colour, "lw": 1.3, "ls": "--" if dashed else "-"}
    axes.annotate("", tuple(end), tuple(start), arrowprops={**line, "shrinkA": 0, "shrinkB": 0})


def _dashed(axes: Axes, start: np.ndarray, way) -> None:
    axes.plot(*np.array([start, start + np.asarray(way)]).T, color=GREY, lw=0.9, ls="--")


def _angle(axes: Axes, at: np.ndarray, radius: float, between, name: str) -> None:
    first, last = np.degrees(between)
    axes.add_patch(
        Arc(tuple(at), 2 * radius, 2 * radius, theta1=first, theta2=last, color=VERMILION)
    )
    middle = 0.5 * sum(between)
    place = at + 1.12 * radius * np.array([np.cos(middle), np.sin(middle)])
    _label(axes, place, name, VERMILION, va="center")


def _label(axes: Axes, at: np.ndarray, text: str, colour: str, **look: Any) -> None:
    axes.text(float(at[0]), float(at[1]), text, color=colour, **look)


def _wheel(at: np.ndarray, angle: float, base: float) -> Polygon:
    length, width = (base * share / 2 for share in WHEEL)
    corners = np.array([[-length, -width], [length, -width], [length, width], [-length, width]])
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    return Polygon(at + corners @ turn, closed=True, fc=INK, ec=INK)
