"""Navigation: robots among discs, by the planning network, by IPOPT, and by the paper's rule.

Worlds of three to eight discs, every second one moving, of seeds that no design uses. All planners
have the same robot, horizon, margins, price and shield, except the paper's, which has no shield.
Beside the network of linear cells and half-planes, one of nonlinear cells and discs.
``--pictures DIR`` draws the first three journeys of each that fail.
"""

import argparse
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from bench.figure import Figure, show
from bench.nlp_planner import NlpPlanner

from ann_dc import plotting
from ann_dc.navigation import (
    Journey,
    Planner,
    Shield,
    design_planner,
    design_waypoint_planner,
    drive,
    planner_for,
    random_world,
)
from ann_dc.plotting.worlds import journey as picture
from ann_dc.problem.robots import NONLINEAR, Robot, car_robot, planning_problem

FIRST, WORLDS = 1000, 200
"""Seed of the first world, and how many."""
SETTING = {"horizon": 20, "dt": 0.1, "pull": 0.15}
"""Of all planners."""
BUDGETS = (1000.0, 300.0, 100.0, 30.0)
"""Fastest time constants a period."""
SETTLED = 1e-3
"""Residual of a plan that counts as settled."""
IN_CONTACT = 1e-5, 0.5
"""Shares of the price between which a period counts as one in contact."""


def planners(robot: Robot) -> Iterator[tuple[str, Planner, bool]]:
    """Name, planner, and whether it has a shield; IPOPT first."""
    yield "IPOPT", NlpPlanner(robot=robot, **SETTING), True
    network = design_planner(robot, **SETTING)
    for budget in BUDGETS:
        yield f"network, {budget:g} a period", replace(network, budget=budget), True
    soft = network.planning.soft
    discs = planning_problem(robot, **SETTING, slots=8, reach=4.0, soft=soft, form=NONLINEAR)
    yield "nonlinear cells, 1000 a period", planner_for(discs), True
    legs = design_waypoint_planner(robot)
    yield "waypoints (IV.C)", legs, False
    yield "waypoints as printed", replace(legs, as_printed=True), False


def figures(first: int = FIRST, count: int = WORLDS, out: Path | None = None) -> Iterator[Figure]:
    """How many are free of collisions, at the goal, and settled in contact."""
    robot = car_robot(reverse=0.8)
    worlds = [random_world(first + i, robot=robot) for i in range(count)]
    free: set[str] = set()
    for name, planner, shielded in planners(robot):
        began = time.perf_counter()
        journeys = drive(worlds, planner, shield=Shield() if shielded else None)
        seconds = time.perf_counter() - began
        if out is not None:
            _draw(name, journeys, out)
        unhurt = {j.world.name for j in journeys if not j.collided}
        free = free or unhurt
        yield _figure(name, journeys, unhurt, free, seconds)


def _figure(
    name: str, journeys: Sequence[Journey], unhurt: set[str], free: set[str], seconds: float
) -> Figure:
    there = [j for j in journeys if j.arrived and not j.collided]
    pressed = np.concatenate([j.pressed[1:] for j in journeys])
    residuals = np.concatenate([j.residuals[1:] for j in journeys])
    low, high = IN_CONTACT
    contact = (pressed > low) & (pressed < high)
    settled = f"{(residuals[contact] < SETTLED).mean():.0%}" if contact.any() else "none"
    bar = {"network, 1000 a period": 0.96, "network, 300 a period": 0.9}.get(name, 0.0)
    return Figure(
        name=name,
        value=f"{len(unhurt)} of {len(journeys)} free of collisions, {len(there)} at the goal",
        remark=(
            f"{len(unhurt & free)} of the {len(free)} in which IPOPT is free; periods in contact "
            f"settled to {SETTLED:g}: {settled}; way {np.mean([j.length for j in there]):.2f}, "
            f"effort {np.mean([j.effort for j in there]):.1f}, {seconds:.0f} s in all"
        ),
        good=len(unhurt & free) >= bar * len(free),
    )


def _draw(name: str, journeys: Sequence[Journey], out: Path) -> None:
    failed = [j for j in journeys if j.collided or not j.arrived]
    for number, journey in enumerate(sorted(failed, key=lambda j: not j.collided)[:3]):
        plotting.save(picture(journey), out / f"{name.replace(' ', '_')}_{number}.png")


def main() -> int:
    """Print the table; exit code 1 if a bar is missed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--first", type=int, default=FIRST, help="seed of the first world")
    parser.add_argument("--worlds", type=int, default=WORLDS)
    parser.add_argument("--pictures", type=Path)
    options = parser.parse_args()
    return show(figures(options.first, options.worlds, options.pictures))


if __name__ == "__main__":
    raise SystemExit(main())
