"""Figure and film of a robot among obstacles, in a closed-loop run."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

import numpy as np
from matplotlib.animation import FuncAnimation, PillowWriter
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Polygon
from matplotlib.ticker import NullFormatter

from ann_dc.files import write_whole
from ann_dc.navigation.closed_loop import SETTLED, ClosedLoopRun
from ann_dc.navigation.obstacles import Obstacle
from ann_dc.plotting import style
from ann_dc.plotting.style import BLUE, GREEN, GREY, INK, ORANGE, SKY, VERMILION
from ann_dc.validation import checked

PLANS = 8
"""Number of plans drawn with the path."""
ROBOTS = 12
"""Number of robot discs drawn along the path."""
STANDING = "#C9C9C9"
MOVING = "#E8C9A0"


@checked
def journey(journey: ClosedLoopRun) -> Figure:
    """Plot the path of a robot and the quantities of its network.

    Left, the plane with the final obstacle positions; arrows are the paths of moving obstacles.
    Right, over time, three quantities. The first is the clearance between the robot's edge and the
    nearest object. The second is the largest multiplier of an obstacle constraint relative to its
    penalty weight. The third is the residual of each plan. The last two require a planner that has
    them.
    """
    figure = style.new_figure(10.4, 5.2)
    draws = (_room, _pressed, _residual) if _known(journey).any() else (_room,)
    grid = figure.add_gridspec(len(draws), 2, width_ratios=[1.25, 1.0])
    plane(figure.add_subplot(grid[:, 0]), journey)
    panels: list[Axes] = []
    for row, draw in enumerate(draws):
        panels.append(figure.add_subplot(grid[row, 1], sharex=panels[0] if panels else None))
        draw(panels[-1], journey)
        style.quiet(panels[-1])
        panels[-1].tick_params(labelbottom=row == len(draws) - 1)
    panels[-1].set_xlabel("time (s)")
    figure.align_ylabels(panels)
    style.headline(figure, str(journey).splitlines()[0])
    style.legend_below(figure)
    return figure


@checked
def plane(axes: Axes, journey: ClosedLoopRun) -> None:
    """Draw a scenario with the complete path in given axes.

    Examples
    --------
    >>> figure = ann_dc.plotting.new_figure(5, 5)  # doctest: +SKIP
    >>> plane(figure.subplots(), driven)  # doctest: +SKIP
    """
    world, end = journey.world, journey.dt * journey.u.shape[1]
    for obstacle in world.obstacles:
        axes.add_patch(_patch_of(obstacle, end))
        if obstacle.moves:
            first, last = obstacle.centres(np.array([0.0, end]))
            axes.annotate(
                "", last, first, arrowprops={"arrowstyle": "->", "color": ORANGE, "lw": 1.0}
            )
    for number in np.unique(np.linspace(0, len(journey.plans) - 1, PLANS).astype(int)):
        x, y = journey.plans[number][:2]
        axes.plot(x, y, color=SKY, lw=0.8, label="plans" if number == 0 else None)
    x, y = journey.q[:2]
    for k in np.unique(np.linspace(0, len(x) - 1, ROBOTS).astype(int)):
        axes.add_patch(Circle((x[k], y[k]), world.robot.radius, ec=BLUE, fc="none", lw=0.8))
    axes.plot(x, y, color=BLUE, lw=2.0, label="path of the robot")
    shielded = np.flatnonzero(journey.shielded)
    if len(shielded):
        axes.plot(x[shielded], y[shielded], ".", color=VERMILION, ms=5, label="safety filter")
    _ends(axes, journey)


def _ends(axes: Axes, journey: ClosedLoopRun) -> None:
    """Mark start and goal, and set axes that contain both."""
    world = journey.world
    axes.plot(*world.start[:2], "s", mfc="white", mec=GREEN, ms=9, label="start")
    axes.plot(*world.goal, "*", color=VERMILION, ms=14, label="goal")
    places = np.column_stack([journey.q[:2], world.start[:2], world.goal])
    low, high = places.min(axis=1) - 0.8, places.max(axis=1) + 0.8
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), xlabel="x (m)", ylabel="y (m)")
    axes.set_aspect("equal")
    style.quiet(axes)


def _patch_of(obstacle: Obstacle, time: float) -> Circle | Polygon:
    """Return the drawing of an obstacle at a given time."""
    colour = MOVING if obstacle.moves else STANDING
    corners = obstacle.corners + time * obstacle.velocity
    if len(corners) == 1:
        return Circle(tuple(corners[0]), obstacle.radius, fc=colour, ec=GREY, lw=0.8)
    return Polygon(corners, closed=True, fc=colour, ec=GREY, lw=0.8)


def _time(journey: ClosedLoopRun) -> np.ndarray:
    return journey.dt * np.arange(journey.u.shape[1])


def _known(journey: ClosedLoopRun) -> np.ndarray:
    """Return (K,) booleans: True if the plan of a period has a residual."""
    return np.isfinite(journey.residuals) & (journey.residuals > 0)


def _room(axes: Axes, journey: ClosedLoopRun) -> None:
    axes.plot(_time(journey), np.minimum(journey.clearance, journey.world.sensor), color=INK)
    axes.axhline(0.0, color=VERMILION, lw=0.8)
    axes.set_ylabel("clearance (m)")


def _pressed(axes: Axes, journey: ClosedLoopRun) -> None:
    axes.plot(_time(journey), journey.relative_multiplier, color=ORANGE)
    axes.set(ylabel="largest multiplier\n(fraction of penalty weight)", ylim=(-0.05, 1.05))


def _residual(axes: Axes, journey: ClosedLoopRun) -> None:
    known = _known(journey)
    axes.semilogy(_time(journey)[known], journey.residuals[known], color=BLUE)
    axes.axhline(SETTLED, color=GREY, lw=0.8, ls=":")
    axes.yaxis.set_minor_formatter(NullFormatter())
    axes.set_ylabel("KKT residual (relative)")


FRAMES_A_SECOND = 10
DOTS = 70
"""Resolution in dots per inch."""


@checked
def film(journey: ClosedLoopRun, path: str | os.PathLike[str]) -> None:
    """Write a closed-loop run as a GIF: robot and plan left, neuron states right.

    The path must end in ``.gif``.
    """
    figure = style.new_figure(8.6, 4.6)
    left, right = figure.subplots(1, 2, width_ratios=[1.2, 1.0])
    _ends(left, journey)
    moving = [left.add_patch(_patch_of(obstacle, 0.0)) for obstacle in journey.world.obstacles]
    (plan,) = left.plot([], [], color=SKY, lw=1.2)
    (way,) = left.plot([], [], color=BLUE, lw=2.0)
    robot = left.add_patch(Circle((0, 0), journey.world.robot.radius, fc=BLUE, ec="white"))
    stages = journey.plans[0].shape[1]
    lines = [right.plot([], [], lw=1.2, label=str(q))[0] for q in journey.world.robot.states[2:]]
    every = np.concatenate([p[2:].ravel() for p in journey.plans])
    right.set(xlim=(0, stages - 1), ylim=(every.min() - 0.1, every.max() + 0.1))
    right.set(xlabel="cell (stages ahead)", ylabel="neurons q of the plan (rad)")
    right.legend(frameon=False, loc="upper right")
    style.quiet(right)
    style.headline(figure, journey.world.name)

    def draw(k: int) -> None:
        time = k * journey.dt
        for number, obstacle in enumerate(journey.world.obstacles):
            moving[number].remove()
            moving[number] = left.add_patch(_patch_of(obstacle, time))
        plan.set_data(*journey.plans[k][:2])
        way.set_data(*journey.q[:2, : k + 1])
        robot.center = tuple(journey.q[:2, k])
        for line, row in zip(lines, journey.plans[k][2:]):
            line.set_data(np.arange(len(row)), row)
        left.set_title(f"{time:.1f} s", loc="left", fontsize=9)

    made = FuncAnimation(figure, draw, frames=len(journey.plans))
    with tempfile.TemporaryDirectory() as folder:
        whole = Path(folder, "film.gif")
        made.save(whole, writer=PillowWriter(fps=FRAMES_A_SECOND), dpi=DOTS)
        write_whole(path, whole.read_bytes())
