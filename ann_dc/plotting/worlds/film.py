"""Film of a closed-loop run: the robot in its scenario, and its neurons."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

import numpy as np
from matplotlib.animation import FuncAnimation, PillowWriter
from matplotlib.patches import Circle

from ann_dc.files import write_whole
from ann_dc.navigation.closed_loop import ClosedLoopRun
from ann_dc.plotting.style import BLUE, SKY, headline, new_figure, quiet
from ann_dc.plotting.worlds.journey import ends, patch_of
from ann_dc.validation import checked

FRAMES_A_SECOND = 10
DOTS = 70
"""Resolution in dots per inch."""


@checked
def film(journey: ClosedLoopRun, path: str | os.PathLike[str]) -> None:
    """Write a closed-loop run as a GIF: robot and plan left, neuron states right.

    The path must end in ``.gif``.
    """
    figure = new_figure(8.6, 4.6)
    left, right = figure.subplots(1, 2, width_ratios=[1.2, 1.0])
    ends(left, journey)
    moving = [left.add_patch(patch_of(obstacle, 0.0)) for obstacle in journey.world.obstacles]
    (plan,) = left.plot([], [], color=SKY, lw=1.2)
    (way,) = left.plot([], [], color=BLUE, lw=2.0)
    robot = left.add_patch(Circle((0, 0), journey.world.robot.radius, fc=BLUE, ec="white"))
    stages = journey.plans[0].shape[1]
    lines = [right.plot([], [], lw=1.2, label=str(q))[0] for q in journey.world.robot.states[2:]]
    every = np.concatenate([p[2:].ravel() for p in journey.plans])
    right.set(xlim=(0, stages - 1), ylim=(every.min() - 0.1, every.max() + 0.1))
    right.set(xlabel="cell (stages ahead)", ylabel="neurons q of the plan (rad)")
    right.legend(frameon=False, loc="upper right")
    quiet(right)
    headline(figure, journey.world.name)

    def draw(k: int) -> None:
        time = k * journey.dt
        for number, obstacle in enumerate(journey.world.obstacles):
            moving[number].remove()
            moving[number] = left.add_patch(patch_of(obstacle, time))
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
