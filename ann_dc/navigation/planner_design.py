"""Gain design of a planning network from many obstacle contacts.

1. A first network is designed without obstacles.
2. The network drives through a few worlds. Its inputs and states at contacts with obstacles are
   recorded.
3. The closed-form gain rule is applied to all contacts together, with several penalty factors. Each
   network, and the recording network, restarts the period of every contact. The network with the
   least mean time is selected; a period that does not settle within the budget has a high cost. The
   selected network drives through other worlds, and so on.

The slow modes in contact are the costates of the position. If most controls are saturated, only the
compliance of the constraints determines their common part, and the compliance must move many
costates. Faster multipliers make this mode faster and increase the fastest rate.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ann_dc.analysis.linearisation import Linearisation
from ann_dc.decomposition.equations import decompose
from ann_dc.errors import DesignError
from ann_dc.gain_design.gain_rule import MULTILEVEL_RULE
from ann_dc.gain_design.gains import apply_gains
from ann_dc.gain_design.grid_gains import SettledPoint
from ann_dc.gain_design.procedure import design
from ann_dc.gain_design.trial_run import gains_of, spectrum_with
from ann_dc.navigation.closed_loop import SETTLED, drive
from ann_dc.navigation.network_planner import NetworkPlanner
from ann_dc.navigation.planner import Plan, Situation
from ann_dc.navigation.scenario import Scenario, random_scenario
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.base import PreconditionerKind
from ann_dc.problem.robot import Robot
from ann_dc.problem.robot_planning import Planning, planning_problem
from ann_dc.problem.soft import Soft
from ann_dc.progress import Progress, silent
from ann_dc.synthesis.synthesis import synthesize
from ann_dc.validation import Count, Positive, checked

SOFT = Soft(weight=100.0, compliance=0.002)
"""Soft constraint: price above the gain from a violation, small compliance for dependent rows."""
TURNS = 3
"""Number of gain designs from contacts."""
WORLDS = 12
"""Number of worlds over all designs."""
POINTS = 24
"""Number of contacts for one gain design."""
JUDGED = 4
"""Interval of the contacts at which a spectrum is computed."""
PERIODS = 120
"""Number of contact periods that candidate networks restart."""
HELD = 1e-3, 0.5
"""Range of a multiplier, as fractions of the price, that indicates a contact that can be held."""
CALM = 1e-2
"""Residual below which a state is close to its equilibrium."""
UNSETTLED = 10.0
"""Cost, in budgets, of a period in which a network has not settled."""
PENALTIES = (1.4, 2.0, 2.8, 4.0)
"""Candidate penalty factors."""
GAIN_RULE = replace(MULTILEVEL_RULE, by_reachability=True, coarse=0.25, dual=3.0, dual_coupling=3.0)
"""Gain rule with multipliers twice as fast, and coarse-level neurons half as fast, as without
active constraints.
"""
FIRST_SEED = 10_000
"""First seed of the random worlds of a design."""


@checked
def design_planner(
    robot: Robot,
    *,
    horizon: Count = 20,
    dt: Positive = 0.1,
    slots: Count = 8,
    pull: Positive = 0.15,
    soft: Soft = SOFT,
    worlds: Sequence[Scenario] | None = None,
    progress: Progress = silent,
) -> NetworkPlanner:
    """Design a planning network for a robot, with gains for obstacle contacts.

    Raises `DesignError` if the price is not finite, or the robot touches nothing in the worlds of
    its design.

    Parameters
    ----------
    robot : Robot
        Robot model.
    horizon : int
        Number of stages of a plan.
    dt : float
        Control period and stage duration, in seconds.
    slots : int
        Number of obstacles that a cell can avoid at once; the nearest obstacles are used.
    pull : float
        Weight of the squared distance to the goal, per stage.
    soft : Soft
        Soft-constraint parameters of all obstacle constraints, with a finite price.
    worlds : sequence of Scenario, optional
        Worlds for contacts, by default 12 random worlds. Each third uses the gains from the
        preceding third.
    progress : Progress
        Receives status messages, one line at a time.

    Examples
    --------
    >>> from ann_dc.problem import car_robot
    >>> planner = design_planner(car_robot(), horizon=16)  # doctest: +SKIP
    """
    if not np.isfinite(soft.weight):
        raise DesignError(
            "soft: expected a finite weight (for a robot between two obstacles), got "
            f"{soft.weight!r}"
        )
    reach = float(robot.limits[0, 1]) * horizon * dt
    planning = planning_problem(
        robot, horizon=horizon, dt=dt, slots=slots, pull=pull, reach=reach, soft=soft
    )
    return planner_for(planning, worlds=worlds, progress=progress)


@checked
def planner_for(
    planning: Planning, *, worlds: Sequence[Scenario] | None = None, progress: Progress = silent
) -> NetworkPlanner:
    """Design a planning network for a planning problem of either form.

    Raises `DesignError` if the robot touches nothing in the worlds of its design.
    """
    robot = planning.robot
    network = synthesize(decompose(planning.problem))
    first = design(
        _on_a_straight(planning, network),
        preconditioner=PreconditionerKind.MULTILEVEL,
        progress=progress,
    )
    planner = NetworkPlanner(planning=planning, network=first.network, radius=first.spectrum.radius)
    if worlds is None:
        worlds = [random_scenario(FIRST_SEED + i, robot=robot) for i in range(WORLDS)]
    touched = False
    for turn in range(TURNS):
        scout = _Scout(planner)
        drive(worlds[turn::TURNS] or worlds, scout, progress=progress)
        if scout.contacts:
            touched, planner = True, _best(planner, scout.contacts, progress)
    if not touched:
        raise DesignError("robot: no contact with an obstacle in the scenarios of the design")
    return planner


def _on_a_straight(planning: Planning, network: Network) -> Network:
    """Return the network at half speed, straight towards a goal beyond its horizon."""
    robot, stages = planning.robot, network.stages
    q, u = np.zeros((len(robot.states), stages)), np.zeros((len(robot.controls), stages))
    u[0] = robot.limits[0, 1] / 2
    q[0] = u[0] * planning.dt * np.arange(stages)
    goal = np.array([2 * q[0, -1], 0.0])
    return network.with_inputs(planning.model_inputs(q, u) | planning.goal_inputs(goal))


class _Contact(NamedTuple):
    """Period in contact: inputs, initial and final state, True if nearly settled."""

    inputs: dict[str, np.ndarray]
    begun: np.ndarray
    ended: np.ndarray
    calm: bool

    def point(self, network: Network) -> SettledPoint:
        """Return the final state as a point for the gain rule."""
        here = network.with_inputs(self.inputs)
        return SettledPoint(Linearisation(here).at(self.ended), self.ended)


class _Scout:
    """Planner that records the contacts of its network."""

    def __init__(self, planner: NetworkPlanner) -> None:
        self.planner, self.dt, self.driver = planner, planner.dt, planner.begin()
        self.contacts: list[_Contact] = []

    def begin(self) -> _Scout:
        """Return the single driver, which is the planner itself."""
        return self

    def plan(self, situations: Sequence[Situation]) -> list[Plan]:
        """Return the plans and record the contacts."""
        plans, (low, high) = self.driver.plan(situations), HELD
        batch, begun = self.driver.batch, self.driver.begun
        for sample, plan in enumerate(plans if len(batch) == len(plans) else ()):
            if low < plan.relative_multiplier < high:
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
    """Return the planner whose gains have the least mean settling time over all contacts.

    The gains are computed from calm contacts, if any.
    """
    calm = [contact for contact in contacts if contact.calm] or contacts
    points = [contact.point(planner.network) for contact in _spread(calm, POINTS)]
    periods = _spread(contacts, PERIODS)
    inputs = {name: np.array([p.inputs[name] for p in periods]) for name in periods[0].inputs}
    begun = np.array([period.begun for period in periods])
    found = [(_mean_time(planner, inputs, begun), planner)]
    for penalty in PENALTIES:
        gains = gains_of(points, GAIN_RULE, penalty)
        radius = max(spectrum_with(point, gains).radius for point in points[::JUDGED])
        tried = replace(planner, network=apply_gains(planner.network, gains), radius=radius)
        found.append((_mean_time(tried, inputs, begun), tried))
        progress(
            f"{len(periods)} contacts, penalty factor {penalty:g}: mean time {found[-1][0]:.0f}"
        )
    return min(found, key=lambda entry: entry[0])[1]


def _mean_time(planner: NetworkPlanner, inputs: dict[str, np.ndarray], begun: np.ndarray) -> float:
    """Return the mean settling time of contacts, in fastest time constants."""
    run = replace(planner, tolerance=SETTLED).run(inputs, begun, planner.budget)
    times = run.settling_times * planner.radius
    return float(np.where(run.settled, times, UNSETTLED * planner.budget).mean())
