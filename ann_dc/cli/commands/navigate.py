"""``ann-dc navigate``: robot among obstacles, replanned every control period."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import typer

from ann_dc.cli.arguments.lookup import named
from ann_dc.cli.arguments.output import QuietOption
from ann_dc.cli.terminal import console, list_files, progress_line
from ann_dc.progress import Progress

PLANNERS = {"network": "network", "waypoint": "waypoint", "as-printed": "as-printed"}


def navigate(
    world: Annotated[Path, typer.Argument(metavar="WORLD.toml", help="The world, as text.")],
    planner: Annotated[
        str,
        typer.Option(metavar="KIND", help="network; waypoint (the paper's IV.C); or as-printed."),
    ] = "network",
    budget: Annotated[
        float,
        typer.Option(metavar="N", help="Fastest time constants that the network has each period."),
    ] = 1000.0,
    horizon: Annotated[int, typer.Option(metavar="N", help="Stages of a plan.")] = 20,
    period: Annotated[
        float, typer.Option(metavar="SECONDS", help="Control period, a stage of the plan.")
    ] = 0.1,
    safety_filter: Annotated[
        bool, typer.Option(help="Whether the safety filter steps in where a plan would collide.")
    ] = True,
    film: Annotated[bool, typer.Option("--film", help="Write a film too (GIF).")] = False,
    out: Annotated[Path, typer.Option(metavar="DIR", help="Folder for the pictures.")] = (
        Path("out")
    ),
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
        from ann_dc.plotting.saving import save
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
