"""Navigation: robots among discs, by the planning network, IPOPT and the paper's rule.

Worlds of three to eight discs, every second one moving, of seeds that no design uses. All planners
have the same robot, horizon, margins, price and shield, except the paper's, which has no shield.
Beside the network of linear cells and half-planes, one of nonlinear cells and discs.
``--pictures DIR`` draws the first three journeys of each that fail.
"""

import argparse
import itertools
import multiprocessing
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple, TypeAlias

import numpy as np
from bench.figure import Figure, show
from bench.nlp_planner import NlpPlanner

from ann_dc import plotting
from ann_dc.navigation.closed_loop import ClosedLoopRun, drive
from ann_dc.navigation.planner import Planner
from ann_dc.navigation.planner_design import design_planner, planner_for
from ann_dc.navigation.safety_filter import SafetyFilter
from ann_dc.navigation.scenario import random_scenario
from ann_dc.navigation.waypoint_planner import design_waypoint_planner
from ann_dc.plotting.worlds import journey as picture
from ann_dc.problem.robot import Robot, car_robot
from ann_dc.problem.robot_planning import NONLINEAR, planning_problem
from ann_dc.problem.soft import Soft

FIRST, WORLDS = 1000, 200
"""Seed of the first world, and how many."""
FEW = 30
"""Worlds for nonlinear cells, which take long: in contact they often do not settle."""
PROCESSES = 3
"""In which planners are designed and drive."""
SETTING = {"horizon": 20, "dt": 0.1, "pull": 0.15}
"""Of all planners."""
SOFT = Soft(weight=100.0, compliance=0.002)
BUDGETS = (1000.0, 300.0, 100.0, 30.0)
"""Fastest time constants (tau_min) a period."""
BARS = {"network, 1000 tau_min a period": 0.96, "network, 300 tau_min a period": 0.9}
"""Share of the worlds in which IPOPT is free, in which these are to be free."""
IN_TIME = {"network, 1000 tau_min a period": 0.95}
"""Share of the periods in contact that are to settle."""
SETTLED = 1e-3
"""Residual of a plan that counts as settled."""
IN_CONTACT = 1e-5, 0.5
"""Shares of the price between which a period counts as one in contact."""


Kind: TypeAlias = Iterator[tuple[str, Planner, int]]
"""Name, planner, and in how many worlds it drives at most."""


def ipopt(robot: Robot) -> Kind:
    """What a digital computer would do."""
    yield "IPOPT", NlpPlanner(robot=robot, **SETTING), WORLDS


def networks(robot: Robot) -> Kind:
    """The planning network with less and less time."""
    network = design_planner(robot, **SETTING)
    for budget in BUDGETS:
        yield f"network, {budget:g} tau_min a period", replace(network, budget=budget), WORLDS


def nonlinear(robot: Robot) -> Kind:
    """Cells with the robot's own map and discs."""
    discs = planning_problem(robot, **SETTING, slots=8, reach=4.0, soft=SOFT, form=NONLINEAR)
    yield "nonlinear cells with discs, 1000 tau_min a period", planner_for(discs), FEW


def waypoints(robot: Robot) -> Kind:
    """The paper's rule, which has no shield."""
    segments = design_waypoint_planner(robot)
    yield "waypoints (IV.C)", segments, WORLDS
    yield "waypoints as printed", replace(segments, as_printed=True), WORLDS


class Driven(NamedTuple):
    """What became of a planner's journeys."""

    name: str
    worlds: frozenset[str]
    unhurt: frozenset[str]
    there: int
    settled: float
    cost: str


def figures(first: int = FIRST, count: int = WORLDS, out: Path | None = None) -> Iterator[Figure]:
    """How many are free of collisions, at the goal, and settled in contact."""
    with ProcessPoolExecutor(PROCESSES, multiprocessing.get_context("spawn")) as pool:
        kinds = (ipopt, networks, nonlinear, waypoints)
        runs = [pool.submit(_driven, kind, first, count, out) for kind in kinds]
        ((exact,), *others) = (run.result() for run in runs)
        for driven in (exact, *itertools.chain(*others)):
            yield _figure(driven, exact.unhurt & driven.worlds)


def _driven(
    kind: Callable[[Robot], Kind], first: int, count: int, out: Path | None
) -> list[Driven]:
    robot = car_robot(reverse=0.8)
    worlds = [random_scenario(first + i, robot=robot) for i in range(count)]
    found = []
    for name, planner, most in kind(robot):
        began = time.perf_counter()
        journeys = drive(
            worlds[:most], planner, safety_filter=None if kind is waypoints else SafetyFilter()
        )
        seconds = time.perf_counter() - began
        if out is not None:
            _draw(name, journeys, out)
        found.append(_summary(name, journeys, seconds))
        print(f"{name}: {len(journeys)} journeys", flush=True)
    return found


def _summary(name: str, journeys: Sequence[ClosedLoopRun], seconds: float) -> Driven:
    there = [j for j in journeys if j.arrived and not j.collided]
    pressed = np.concatenate([j.relative_multiplier[1:] for j in journeys])
    residuals = np.concatenate([j.residuals[1:] for j in journeys])
    low, high = IN_CONTACT
    contact = (pressed > low) & (pressed < high)
    way, effort = (np.mean([getattr(j, key) for j in there]) for key in ("length", "effort"))
    return Driven(
        name=name,
        worlds=frozenset(j.world.name for j in journeys),
        unhurt=frozenset(j.world.name for j in journeys if not j.collided),
        there=len(there),
        settled=float((residuals[contact] < SETTLED).mean()) if contact.any() else np.nan,
        cost=f"path length {way:.2f} m, effort {effort:.1f}, {seconds:.0f} s in all",
    )


def _figure(driven: Driven, free: frozenset[str]) -> Figure:
    name, unhurt, both = driven.name, len(driven.unhurt), len(driven.unhurt & free)
    settled = "none" if np.isnan(driven.settled) else f"{driven.settled:.1%}"
    return Figure(
        name=f"robots among discs: {name}",
        value=f"{unhurt} of {len(driven.worlds)} free of collisions, {driven.there} at the goal",
        remark=(
            f"{both} of the {len(free)} in which IPOPT is free; periods in contact settled to "
            f"{SETTLED:g}: {settled}; {driven.cost}"
        ),
        good=both >= BARS.get(name, 0.0) * len(free)
        and (name not in IN_TIME or driven.settled >= IN_TIME[name]),
    )


def _draw(name: str, journeys: Sequence[ClosedLoopRun], out: Path) -> None:
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
