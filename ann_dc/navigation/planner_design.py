"""Gains of a planning network: read off many contacts at once.

1. A first network is designed without any obstacle.
2. It drives through a few worlds; where it touches obstacles, its inputs and states are kept.
3. The closed form is read off all contacts together, with several penalties. What wins has the
   smallest geometric mean of the times that contacts need, in fastest time constants of them all.
   It drives through worlds of its own, and so on.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ann_dc.analysis.linearisation import Linearisation
from ann_dc.decomposition.equations import decompose
from ann_dc.errors import DesignError
from ann_dc.gain_design.freeze import gains_of, spectrum_with
from ann_dc.gain_design.procedure import design
from ann_dc.gain_design.rules.gains import Gains, apply_gains
from ann_dc.gain_design.rules.grid_gains import SettledPoint
from ann_dc.gain_design.rules.recipe import WITH_COORDINATORS
from ann_dc.hints.checked import checked
from ann_dc.hints.values import Count, Positive
from ann_dc.navigation.closed_loop import drive
from ann_dc.navigation.network_planner import NetworkPlanner
from ann_dc.navigation.planner import Plan, Situation
from ann_dc.navigation.world import World, random_world
from ann_dc.network.metrics.contract import Kind
from ann_dc.network.network import Network
from ann_dc.problem.constraints.soft import Soft
from ann_dc.problem.robots.planning import Planning, planning_problem
from ann_dc.problem.robots.robot import Robot
from ann_dc.progress import Progress, silent
from ann_dc.synthesis.synthesis import synthesize

SOFT = Soft(price=100.0, compliance=0.001)
"""What rows cost: more than keeping one is worth, and a little room for those that depend."""
TURNS = 2
"""Times that gains are read off contacts."""
WORLDS = 12
"""Worlds to drive through in all of them."""
POINTS = 24
"""Contacts that gains are read off."""
JUDGED = 3
"""Every so many contacts, one at which gains are judged."""
HELD = 1e-3, 0.9
"""Shares of the price between which a multiplier tells of a contact that can be held."""
CALM = 1e-2
"""Residual below which a state is near enough to where it would settle."""
REPELS = 1e6
"""Fastest time constants that a contact counts which repels."""
PENALTIES = (1.0, 2.0, 4.0)
BY_REACH = (True, False)
COARSE = (0.25, 0.5)
"""Factors on the penalties, weights of rows, and shares of coordinators' gains to choose from."""
FIRST_SEED = 10_000
"""Of the random worlds of a design."""


@checked
def design_planner(
    robot: Robot,
    *,
    horizon: Count = 20,
    dt: Positive = 0.1,
    slots: Count = 8,
    pull: Positive = 0.15,
    soft: Soft = SOFT,
    worlds: Sequence[World] | None = None,
    progress: Progress = silent,
) -> NetworkPlanner:
    """A planning network for a robot, with gains that hold in contact.

    Parameters
    ----------
    robot : Robot
    horizon : int
        Stages of a plan.
    dt : float
        Control period and stage, in seconds.
    slots : int
        Obstacles that a cell can keep clear of at once, the nearest ones.
    pull : float
        Weight of the squared distance to the goal, a stage.
    soft : Soft
        Of all rows; with a finite price.
    worlds : sequence of World, optional
        To meet obstacles in, half of them with the gains that the other half led to; a dozen
        random ones by default.
    progress : Progress

    Returns
    -------
    NetworkPlanner

    Raises
    ------
    DesignError
        If the price is not finite, or the robot touches nothing in the worlds of its design.

    Examples
    --------
    >>> from ann_dc.problem.robots import car_robot
    >>> planner = design_planner(car_robot(), horizon=16)  # doctest: +SKIP
    """
    if not np.isfinite(soft.price):
        raise DesignError(
            f"soft: a robot between two obstacles needs a finite price, got {soft.price!r}"
        )
    reach = float(robot.limits[0, 1]) * horizon * dt
    planning = planning_problem(
        robot, horizon=horizon, dt=dt, slots=slots, pull=pull, reach=reach, soft=soft
    )
    network = synthesize(decompose(planning.problem))
    first = design(_on_a_straight(planning, network), kinds=[Kind.PYRAMID], progress=progress)
    planner = NetworkPlanner(planning=planning, network=first.network, radius=first.spectrum.radius)
    contacts: list[SettledPoint] = []
    if worlds is None:
        worlds = [random_world(FIRST_SEED + i, robot=robot) for i in range(WORLDS)]
    for turn in range(TURNS):
        scout = _Scout(planner)
        drive(worlds[turn::TURNS] or worlds, scout, progress=progress)
        contacts += scout.contacts
        if not contacts:
            raise DesignError("robot: it touched nothing in the worlds of its design")
        gains, radius = _best(_spread(contacts, POINTS), progress)
        planner = replace(planner, network=apply_gains(network, gains), radius=radius)
    return planner


def _on_a_straight(planning: Planning, network: Network) -> Network:
    """The network at half the highest speed, straight towards a goal beyond its horizon."""
    robot, stages = planning.robot, network.stages
    q, u = np.zeros((len(robot.states), stages)), np.zeros((len(robot.controls), stages))
    u[0] = robot.limits[0, 1] / 2
    q[0] = u[0] * planning.dt * np.arange(stages)
    goal = np.array([2 * q[0, -1], 0.0])
    return network.with_inputs(planning.model_inputs(q, u) | planning.goal_inputs(goal))


class _Scout:
    """A planner that keeps the contacts that its network meets."""

    def __init__(self, planner: NetworkPlanner) -> None:
        self.planner, self.dt, self.driver = planner, planner.dt, planner.begin()
        self.contacts: list[SettledPoint] = []

    def begin(self) -> _Scout:
        """The one driver that it is."""
        return self

    def plan(self, situations: Sequence[Situation]) -> list[Plan]:
        """What the planner says."""
        plans, (low, high) = self.driver.plan(situations), HELD
        batch = self.driver.batch
        for sample, plan in enumerate(plans if len(batch) == len(plans) else ()):
            if low < plan.pressed < high and plan.residual < CALM:
                linear = Linearisation(batch.network_of(sample)).at(batch.states[sample])
                self.contacts.append(SettledPoint(linear, batch.states[sample]))
        return plans


def _spread(points: Sequence[SettledPoint], count: int) -> list[SettledPoint]:
    chosen = np.unique(np.linspace(0, len(points) - 1, count).round().astype(int))
    return [points[i] for i in chosen]


def _best(points: Sequence[SettledPoint], progress: Progress) -> tuple[Gains, float]:
    """Gains off these points, and the largest radius of a spectrum at some of them."""
    found = []
    for by_reach, coarse, penalty in itertools.product(BY_REACH, COARSE, PENALTIES):
        recipe = replace(WITH_COORDINATORS, by_reach=by_reach, coarse=coarse)
        gains = gains_of(points, recipe, penalty)
        spectra = [spectrum_with(point, gains) for point in points[::JUDGED]]
        radius = max(spectrum.radius for spectrum in spectra)
        decay = np.array([max(-spectrum.abscissa, radius / REPELS) for spectrum in spectra])
        found.append((float(np.exp(np.log(radius / decay).mean())), radius, gains))
        progress(
            f"{len(points)} contacts, penalty x {penalty:g}: mean ratio {found[-1][0]:.3g}, "
            f"worst {(radius / decay).max():.3g}"
        )
    _, radius, gains = min(found, key=lambda entry: entry[0])
    return gains, radius
