"""Planner of the paper, section IV.C: optimal legs and a waypoint at every obstacle.

One network plans legs of all lengths, without obstacles. If the robot sees an obstacle that it is
about to meet, the leg is replaced by two legs: one to a waypoint next to the obstacle, q_obs +
delta, and one from there to the goal. As printed, the leg to the waypoint is omitted: the next leg
is planned as if the robot were at the waypoint already.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ann_dc.backends.ode import OdeBackend
from ann_dc.backends.settling import Settling
from ann_dc.evaluation.populations import neuron_values
from ann_dc.families.family import Sample
from ann_dc.families.family_design import design_family
from ann_dc.navigation.planner import Plan, Situation
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.base import PreconditionerKind
from ann_dc.problem.robot import Robot
from ann_dc.problem.robot_planning import segment_problem
from ann_dc.progress import Progress, silent
from ann_dc.validation import Count, Index, Positive, checked

PACE = 0.7
"""Design speed of a leg, as a fraction of the maximum speed."""
SHORTEST, LONGEST = 1.0, 8.0
"""Range of leg lengths for which the network is designed, in the robot's length unit."""
ASIDE = 0.8
"""Largest angle in rad between the robot's heading and the direction of a design leg."""
SEEN_AHEAD = 1.5
"""Duration in seconds of the plan that is checked for nearby obstacles."""
TRIED = 100
"""Number of held-out legs for the validation of the design."""


@dataclass(frozen=True, kw_only=True, eq=False)
class WaypointPlanner:
    """Planner of the paper's section IV.C; see `design_waypoint_planner`.

    ``network`` serves all legs. ``delta`` (2,) is the offset of the waypoint from the rims of
    obstacle and robot; its direction is the passing side of all obstacles.
    """

    robot: Robot
    network: Network
    dt: float
    delta: np.ndarray
    as_printed: bool = False

    def begin(self) -> WaypointDriver:
        """Return a driver without legs."""
        return WaypointDriver(self)


@checked
def design_waypoint_planner(
    robot: Robot,
    *,
    stages: Count = 24,
    dt: Positive = 0.1,
    aside: Positive = 0.3,
    as_printed: bool = False,
    seed: Index = 0,
    progress: Progress = silent,
) -> WaypointPlanner:
    """Design the paper's planner for a robot, with one network for all legs.

    Parameters
    ----------
    robot : Robot
        Robot model.
    stages : int
        Number of stages of a leg of any length.
    dt : float
        Control period, in seconds.
    aside : float
        Length of delta, which points to the upper left, in the robot's length unit.
    as_printed : bool
        If True, the leg from the robot to the waypoint is omitted.
    seed : int
        Seed of the random legs of the design.
    progress : Progress
        Receives status messages, one line at a time.

    Raises
    ------
    DesignError
        If no leg of the design settles.

    Examples
    --------
    >>> from ann_dc.problem import car_robot
    >>> planner = design_waypoint_planner(car_robot(), stages=8)  # doctest: +SKIP
    """
    problem = segment_problem(robot, stages=stages, reach=3.0)

    def segments(draws: np.random.Generator, count: int) -> list[Sample]:
        return [_segment_inputs(robot, stages, *_drawn(robot, draws)) for _ in range(count)]

    designed = design_family(
        problem,
        segments,
        preconditioner=PreconditionerKind.MULTILEVEL,
        held_out=TRIED,
        seed=seed,
        progress=progress,
    )
    return WaypointPlanner(
        robot=robot,
        network=replace(designed.network, ranges={}),  # a leg that fails is told by its run
        dt=dt,
        delta=aside * np.array([-1.0, 1.0]) / np.sqrt(2.0),
        as_printed=as_printed,
    )


def _drawn(robot: Robot, draws: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Draw a state and a place that is not behind it."""
    low, high = np.where(np.isfinite(robot.state_limits), robot.state_limits / 2, [-np.pi, np.pi]).T
    q = draws.uniform(low, high)
    q[:2] = draws.uniform(0.0, 5.0, 2)
    length, towards = draws.uniform(SHORTEST, LONGEST), draws.uniform(-ASIDE, ASIDE)
    heading = towards + (q[2] if len(q) > 2 else 0.0)
    return q, q[:2] + length * np.array([np.cos(heading), np.sin(heading)])


def _segment_inputs(robot: Robot, stages: int, q: np.ndarray, place: np.ndarray) -> Sample:
    names = [str(state) for state in robot.states]
    values = {f"q_0.{name}": value for name, value in zip(names, q)}
    values |= {f"q_d.{name}": value for name, value in zip(names, place)}
    length = np.clip(np.linalg.norm(place - q[:2]), SHORTEST, LONGEST)
    values["h"] = length / (PACE * robot.limits[0, 1] * stages)
    return {name: np.full(stages, value) for name, value in values.items()}


def _resampled(u: np.ndarray, h: float, dt: float) -> np.ndarray:
    """Average piecewise-constant controls (m, N) of step h over periods dt to (m, K)."""
    ends = h * np.arange(u.shape[1] + 1)
    instants = dt * np.arange(int(np.ceil(ends[-1] / dt)) + 1)
    sums = np.hstack([np.zeros((len(u), 1)), np.cumsum(u * h, axis=1)])
    return np.array([np.diff(np.interp(instants, ends, row)) for row in sums]) / dt


class WaypointDriver:
    """Current legs and passed obstacles of several journeys."""

    def __init__(self, planner: WaypointPlanner) -> None:
        self.planner = planner
        self._segments: dict[int, tuple[np.ndarray, np.ndarray]] = {}
        self._met: dict[int, set[int]] = {}

    def plan(self, situations: Sequence[Situation]) -> list[Plan]:
        """Return the remaining legs, replaced if an obstacle appears."""
        return [self._plan(situation) for situation in situations]

    def _plan(self, situation: Situation) -> Plan:
        number, goal = situation.number, situation.world.goal
        if number not in self._segments:
            self._met[number] = set()
            self._segments[number] = self._segment(situation.q, goal)
        obstacle = self._appears(situation)
        if obstacle is not None:
            self._met[number].add(obstacle)
            waypoint = self._waypoint(situation, obstacle)
            if self.planner.as_printed:
                there = np.r_[waypoint, situation.q[2:]]
                self._segments[number] = self._segment(there, goal)
            else:
                q, u = self._segment(situation.q, waypoint)
                on = self._segment(q[:, -1], goal)
                self._segments[number] = np.hstack([q, on[0][:, 1:]]), np.hstack([u, on[1]])
        q, u = self._segments[number]
        if not u.shape[1]:
            self._segments[number] = q, u = self._segment(situation.q, goal)
        self._segments[number] = q[:, 1:], u[:, 1:]
        return Plan(q=q, u=u)

    def _segment(self, q: np.ndarray, place: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return states and controls of a leg, one per control period.

        A robot at its destination does not move.
        """
        planner, network = self.planner, self.planner.network
        inputs = _segment_inputs(planner.robot, network.stages, q, place)
        batch = OdeBackend(verify=False, settling=Settling(tolerance=1e-4)).run_batch(
            network, {name: value[None] for name, value in inputs.items()}
        )
        found = neuron_values(network, batch.states[0])["u"].T
        if not batch.settled[0]:
            found = np.zeros_like(found)
        u = _resampled(found, inputs["h"][0], planner.dt)
        return planner.robot.steps(planner.dt).rollout(q, u), u

    def _appears(self, situation: Situation) -> int | None:
        """Return a visible, not yet met obstacle that is too close to the plan, or None."""
        world, planner = situation.world, self.planner
        ahead = self._segments[situation.number][0][:2, : int(SEEN_AHEAD / planner.dt)].T
        for number in world.sensed(situation.q[:2], situation.time):
            if number in self._met[situation.number] or not len(ahead):
                continue
            now = np.full(len(ahead), situation.time)
            near = world.obstacles[number].near(ahead, now).distance.min()
            if near < planner.robot.radius:
                return number
        return None

    def _waypoint(self, situation: Situation, number: int) -> np.ndarray:
        """Return the waypoint q_obs + delta (2,), with delta measured from the rim."""
        obstacle, delta = situation.world.obstacles[number], self.planner.delta
        way = delta / np.linalg.norm(delta)
        reach = obstacle.reach(way[None])[0] + self.planner.robot.radius
        return obstacle.centres(np.array([situation.time]))[0] + reach * way + delta
