"""``ann-dc navigate``: robot among obstacles, replanned every control period."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from ann_dc.cli.arguments.options import (
    JsonOption,
    QuietOption,
    argument,
    completing,
    option,
    unfolded,
)
from ann_dc.cli.arguments.words import named
from ann_dc.cli.terminal import finish, progress_line
from ann_dc.progress import Progress
from ann_dc.report.json_file import make_room, picked, write_results

JOURNEY = (
    *("arrived", "collided", "held", "length", "effort", "dt", "q", "u"),
    *("clearance", "shielded", "residuals", "spent"),
)
"""Attributes of a closed-loop run in the JSON file."""

PLANNERS = {"network": "network", "waypoint": "waypoint", "as-printed": "as-printed"}


@unfolded
def navigate(
    *,
    world: Path = argument("Scenario file.", metavar="WORLD.toml"),
    planner: str = option(
        "Planner: network, waypoint (IV.C of the paper) or as-printed.",
        default="network",
        metavar="KIND",
        autocompletion=completing(lambda: PLANNERS),
    ),
    settling_budget: float = option(
        "Network time per control period (tau_min, the fastest time constant).",
        default=1000.0,
        metavar="N",
    ),
    horizon: int = option("Number of stages of a plan.", default=20, metavar="N"),
    period: float = option(
        "Control period, equal to a stage of the plan (s).", default=0.1, metavar="SECONDS"
    ),
    safety_filter: bool = option("Replace controls of a plan that would collide.", default=True),
    animation: bool = option("File of an animation (GIF).", "--animation", default=False),
    output: Path = option("Folder of the figures.", default=Path("out"), metavar="DIR"),
    json_file: JsonOption = None,
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
      ann-dc navigate demos/crossing.toml --settling-budget 300 --animation
      ann-dc navigate demos/crossing.toml --planner waypoint

    Exit code: 0 goal reached without a collision, 1 otherwise, 2 bad input.
    """
    kind = named("--planner", planner, PLANNERS)
    with progress_line(quiet) as progress:
        from ann_dc.errors import ScenarioError, require_positive
        from ann_dc.navigation.closed_loop import SHIELD, drive
        from ann_dc.navigation.scenario import load_scenario
        from ann_dc.plotting.style import save
        from ann_dc.plotting.worlds import film as moving, journey as picture

        require_positive(ScenarioError, **{"--settling-budget": settling_budget})
        declared = load_scenario(world)
        make_room(json_file, figures=output)
        chosen = _designed(kind, declared.robot, settling_budget, horizon, period, progress)
        shielded = SHIELD if safety_filter and kind == "network" else None
        (way,) = drive([declared], chosen, safety_filter=shielded, progress=progress)
        progress("drawing")
        written = [save(picture(way), output / "journey.png")]
        if animation:
            moving(way, output / "journey.gif")
            written.append(output / "journey.gif")
        written += write_results(_as_dict(way, kind), json_file)
    shown = [str(way), str(chosen)] if kind == "network" else [str(way)]
    finish(shown, written, quiet=quiet, code=0 if way.arrived and not way.collided else 1)


def _as_dict(way, planner: str) -> dict[str, Any]:
    """Return outcome and path of a closed-loop run as plain data for JSON."""
    content = {"planner": planner, "scenario": way.world.name, "result": str(way)}
    return content | picked(way, *JOURNEY)


def _designed(kind: str, robot, budget: float, horizon: int, dt: float, progress: Progress) -> Any:
    from ann_dc.navigation.planner_design import design_planner
    from ann_dc.navigation.waypoint_planner import design_waypoint_planner

    if kind == "network":
        designed = design_planner(robot, horizon=horizon, dt=dt, progress=progress)
        return replace(designed, budget=budget)
    return design_waypoint_planner(robot, dt=dt, as_printed=kind == "as-printed", progress=progress)
