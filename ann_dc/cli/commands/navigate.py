"""``ann-dc navigate``: robot among obstacles, replanned every control period."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import typer

from ann_dc.cli.arguments.options import QuietOption, argument, option, unfolded
from ann_dc.cli.arguments.words import named
from ann_dc.cli.terminal import console, list_files, progress_line
from ann_dc.progress import Progress

PLANNERS = {"network": "network", "waypoint": "waypoint", "as-printed": "as-printed"}


@unfolded
def navigate(
    *,
    world: Path = argument("The world, as text.", metavar="WORLD.toml"),
    planner: str = option(
        "network; waypoint (the paper's IV.C); or as-printed.", default="network", metavar="KIND"
    ),
    budget: float = option(
        "Fastest time constants that the network has each period.", default=1000.0, metavar="N"
    ),
    horizon: int = option("Stages of a plan.", default=20, metavar="N"),
    period: float = option("Control period, a stage of the plan.", default=0.1, metavar="SECONDS"),
    safety_filter: bool = option(
        "Whether the safety filter steps in where a plan would collide.", default=True
    ),
    film: bool = option("Write a film too (GIF).", "--film", default=False),
    out: Path = option("Folder for the pictures.", default=Path("out"), metavar="DIR"),
    quiet: QuietOption = False,
) -> None:
    """Drive a robot through a scenario, with a network that plans every period.

    The network gets fixed gains once (in about a minute), from contacts with
    obstacles in other scenarios. In every control period its neurons shift by
    one stage, run for a given number of fastest time constants, and the first
    control is applied. With 10 MHz op amps and a bandwidth margin of 10 a
    fastest time constant is 0.16 us: 1000 of them are 0.16 ms.

    --planner waypoint is section IV.C of the paper: for an obstacle on the
    path it adds a waypoint next to the obstacle, a segment to the waypoint
    and a segment to the goal. --planner as-printed omits the segment to the
    waypoint.

    Usage examples:

      ann-dc navigate demos/crossing.toml
      ann-dc navigate demos/crossing.toml --budget 300 --film
      ann-dc navigate demos/crossing.toml --planner waypoint

    Exit code: 0 goal reached without a collision, 1 otherwise, 2 bad input.
    """
    kind = named("--planner", planner, PLANNERS)
    with progress_line() as progress:
        from ann_dc.errors import ScenarioError, require_positive
        from ann_dc.files import make_folder
        from ann_dc.navigation.closed_loop import SHIELD, drive
        from ann_dc.navigation.scenario import load_scenario
        from ann_dc.plotting.style import save
        from ann_dc.plotting.worlds import film as moving, journey as picture

        require_positive(ScenarioError, **{"--budget": budget})
        declared = load_scenario(world)
        make_folder(out)
        chosen = _designed(kind, declared.robot, budget, horizon, period, progress)
        shielded = SHIELD if safety_filter and kind == "network" else None
        (way,) = drive([declared], chosen, safety_filter=shielded, progress=progress)
        progress("drawing")
        written = [save(picture(way), out / "journey.png")]
        if film:
            moving(way, out / "journey.gif")
            written.append(out / "journey.gif")
    if not quiet:
        console().print(str(way))
        if kind == "network":
            console().print(str(chosen))
        list_files(written)
    raise typer.Exit(0 if way.arrived and not way.collided else 1)


def _designed(kind: str, robot, budget: float, horizon: int, dt: float, progress: Progress) -> Any:
    from ann_dc.navigation.planner_design import design_planner
    from ann_dc.navigation.waypoint_planner import design_waypoint_planner

    if kind == "network":
        designed = design_planner(robot, horizon=horizon, dt=dt, progress=progress)
        return replace(designed, budget=budget)
    return design_waypoint_planner(robot, dt=dt, as_printed=kind == "as-printed", progress=progress)
