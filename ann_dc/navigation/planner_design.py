"""Gains of a planning network: read off many contacts at once.

1. A first network is designed without any obstacle.
2. It drives through a few worlds; where it touches obstacles, its inputs and states are kept.
3. The closed form is read off these contacts together, with several penalties. Each network, and
   the one that met them, begins every contact's period anew; the one wins that needs the least
   time, counted dear where it does not settle in its budget. It drives through other worlds, and
   so on.

What is slow in contact are the costates of the place: where most controls stand at a limit, nothing
but the compliance of the rows holds what they have in common, and they are many to be moved by it.
The faster the multipliers, the faster that mode, at the cost of the fastest one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ann_dc.analysis.linearisation import Linearisation
from ann_dc.decomposition.equations import decompose
from ann_dc.errors import DesignError
from ann_dc.gain_design.gain_rule import WITH_COORDINATORS
from ann_dc.gain_design.gains import apply_gains
from ann_dc.gain_design.grid_gains import SettledPoint
from ann_dc.gain_design.procedure import design
from ann_dc.gain_design.trial_run import gains_of, spectrum_with
from ann_dc.navigation.closed_loop import SETTLED, drive
from ann_dc.navigation.network_planner import NetworkPlanner
from ann_dc.navigation.planner import Plan, Situation
from ann_dc.navigation.scenario import World, random_world
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.base import Kind
from ann_dc.problem.robot import Robot
from ann_dc.problem.robot_planning import Planning, planning_problem
from ann_dc.problem.soft import Soft
from ann_dc.progress import Progress, silent
from ann_dc.synthesis.synthesis import synthesize
from ann_dc.validation.checked import checked
from ann_dc.validation.values import Count, Positive

SOFT = Soft(price=100.0, compliance=0.002)
"""What rows cost: more than keeping one is worth, and a little room for those that depend."""
TURNS = 3
"""Times that gains are read off contacts."""
WORLDS = 12
"""Worlds to drive through in all of them."""
POINTS = 24
"""Contacts that gains are read off."""
JUDGED = 4
"""Every so many contacts, one at which a spectrum is taken."""
PERIODS = 120
"""In contact, that networks begin anew."""
HELD = 1e-3, 0.5
"""Shares of the price between which a multiplier tells of a contact that can be held."""
CALM = 1e-2
"""Residual below which a state is near enough to where it would settle."""
UNSETTLED = 10.0
"""Budgets that a period counts in which a network has not settled."""
PENALTIES = (1.4, 2.0, 2.8, 4.0)
"""Factors on the penalties to choose from."""
RECIPE = replace(WITH_COORDINATORS, by_reach=True, coarse=0.25, dual=3.0, dual_coupling=3.0)
"""With multipliers twice as fast, and coordinators half as fast, as where no row presses."""
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
        To meet obstacles in, a third of them with the gains that another third led to; a dozen
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
    >>> from ann_dc.problem import car_robot
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
    return planner_for(planning, worlds=worlds, progress=progress)


@checked
def planner_for(
    planning: Planning, *, worlds: Sequence[World] | None = None, progress: Progress = silent
) -> NetworkPlanner:
    """A planning network for a planning problem, of either form.

    Parameters
    ----------
    planning : Planning
    worlds, progress
        As of `design_planner`.

    Returns
    -------
    NetworkPlanner

    Raises
    ------
    DesignError
        If the robot touches nothing in the worlds of its design.

    Examples
    --------
    >>> from ann_dc.problem import Soft
    >>> from ann_dc.problem import NONLINEAR, planning_problem, unicycle_robot
    >>> size = {"horizon": 10, "dt": 0.1, "slots": 1, "pull": 0.1, "reach": 2.0}
    >>> discs = planning_problem(
    ...     unicycle_robot(), **size, soft=Soft(price=100.0, compliance=0.002), form=NONLINEAR
    ... )
    >>> planner = planner_for(discs)  # doctest: +SKIP
    """
    robot = planning.robot
    network = synthesize(decompose(planning.problem))
    first = design(_on_a_straight(planning, network), kinds=[Kind.PYRAMID], progress=progress)
    planner = NetworkPlanner(planning=planning, network=first.network, radius=first.spectrum.radius)
    if worlds is None:
        worlds = [random_world(FIRST_SEED + i, robot=robot) for i in range(WORLDS)]
    touched = False
    for turn in range(TURNS):
        scout = _Scout(planner)
        drive(worlds[turn::TURNS] or worlds, scout, progress=progress)
        if scout.contacts:
            touched, planner = True, _best(planner, scout.contacts, progress)
    if not touched:
        raise DesignError("robot: it touched nothing in the worlds of its design")
    return planner


def _on_a_straight(planning: Planning, network: Network) -> Network:
    """The network at half the highest speed, straight towards a goal beyond its horizon."""
    robot, stages = planning.robot, network.stages
    q, u = np.zeros((len(robot.states), stages)), np.zeros((len(robot.controls), stages))
    u[0] = robot.limits[0, 1] / 2
    q[0] = u[0] * planning.dt * np.arange(stages)
    goal = np.array([2 * q[0, -1], 0.0])
    return network.with_inputs(planning.model_inputs(q, u) | planning.goal_inputs(goal))


class _Contact(NamedTuple):
    """A period in contact: inputs, where the network began and ended, whether it had settled."""

    inputs: dict[str, np.ndarray]
    begun: np.ndarray
    ended: np.ndarray
    calm: bool

    def point(self, network: Network) -> SettledPoint:
        """Where the network ended, to read gains off."""
        here = network.with_inputs(self.inputs)
        return SettledPoint(Linearisation(here).at(self.ended), self.ended)


class _Scout:
    """A planner that keeps the contacts that its network meets."""

    def __init__(self, planner: NetworkPlanner) -> None:
        self.planner, self.dt, self.driver = planner, planner.dt, planner.begin()
        self.contacts: list[_Contact] = []

    def begin(self) -> _Scout:
        """The one driver that it is."""
        return self

    def plan(self, situations: Sequence[Situation]) -> list[Plan]:
        """What the planner says."""
        plans, (low, high) = self.driver.plan(situations), HELD
        batch, begun = self.driver.batch, self.driver.begun
        for sample, plan in enumerate(plans if len(batch) == len(plans) else ()):
            if low < plan.pressed < high:
                inputs = {name: values[sample] for name, values in batch.inputs.items()}
                ended, calm = batch.states[sample], plan.residual < CALM
                self.contacts.append(_Contact(inputs, begun[sample], ended, calm))
        return plans


def _spread(contacts: Sequence[_Contact], count: int) -> list[_Contact]:
    chosen = np.unique(np.linspace(0, len(contacts) - 1, count).round().astype(int))
    return [contacts[i] for i in chosen]


def _best(
    planner: NetworkPlanner, contacts: Sequence[_Contact], progress: Progress
) -> NetworkPlanner:
    """The planner with the gains, read off calm contacts if any, that settle soonest in all."""
    calm = [contact for contact in contacts if contact.calm] or contacts
    points = [contact.point(planner.network) for contact in _spread(calm, POINTS)]
    periods = _spread(contacts, PERIODS)
    inputs = {name: np.array([p.inputs[name] for p in periods]) for name in periods[0].inputs}
    begun = np.array([period.begun for period in periods])
    found = [(_mean_time(planner, inputs, begun), planner)]
    for penalty in PENALTIES:
        gains = gains_of(points, RECIPE, penalty)
        radius = max(spectrum_with(point, gains).radius for point in points[::JUDGED])
        tried = replace(planner, network=apply_gains(planner.network, gains), radius=radius)
        found.append((_mean_time(tried, inputs, begun), tried))
        progress(f"{len(periods)} contacts, penalty x {penalty:g}: mean time {found[-1][0]:.0f}")
    return min(found, key=lambda entry: entry[0])[1]


def _mean_time(planner: NetworkPlanner, inputs: dict[str, np.ndarray], begun: np.ndarray) -> float:
    """Fastest time constants until contacts have settled, from where they began."""
    run = replace(planner, tolerance=SETTLED).run(inputs, begun, planner.budget)
    times = run.settling_times * planner.radius
    return float(np.where(run.settled, times, UNSETTLED * planner.budget).mean())
