"""The paper's planner: legs that lead where they should, and waypoints beside what appears."""

import numpy as np
import pytest

from ann_dc import apply_gains, design, synthesize
from ann_dc.navigation.closed_loop import drive
from ann_dc.navigation.obstacles import disc
from ann_dc.navigation.planner import Situation
from ann_dc.navigation.scenario import Scenario
from ann_dc.navigation.waypoint_planner import WaypointPlanner
from ann_dc.network.preconditioners.base import PreconditionerKind
from ann_dc.problem.robot import unicycle_robot
from ann_dc.problem.robot_planning import segment_problem

ROBOT = unicycle_robot(speed=2.0)


@pytest.fixture(scope="module")
def planner():
    """Gains of one leg will do for legs nearly straight ahead."""
    problem = segment_problem(ROBOT, stages=10, reach=3.0)
    network = apply_gains(
        synthesize(problem), design(problem, preconditioner=PreconditionerKind.MULTILEVEL).gains
    )
    delta = 0.3 * np.array([-1.0, 1.0]) / np.sqrt(2)
    return WaypointPlanner(robot=ROBOT, network=network, dt=0.1, delta=delta)


def world(*obstacles, **given):
    start, goal = np.zeros(3), np.array([4.0, 0.5])
    return Scenario(robot=ROBOT, start=start, goal=goal, obstacles=obstacles, **given)


def test_a_leg_leads_to_its_place(planner):
    plan = planner.begin().plan([Situation(world(), 0, np.zeros(3), 0.0)])[0]
    np.testing.assert_allclose(plan.q[:2, -1], [4.0, 0.5], atol=0.1)
    assert drive([world()], planner, safety_filter=None)[0].arrived


def test_what_appears_on_the_way_gets_a_waypoint(planner):
    here = world(disc((2.0, 0.2), 0.3), sensor=1.0)
    (journey,) = drive([here], planner, safety_filter=None)
    (free,) = drive([world()], planner, safety_filter=None)
    assert journey.length > free.length
    beside = here.obstacles[0].centre + (0.45 + 0.3) * np.array([-1, 1]) / np.sqrt(2)
    plans = [plan[:2].T for plan in journey.plans]
    passed = min(np.linalg.norm(plan - beside, axis=1).min() for plan in plans)
    assert passed < 0.15


def test_as_printed_the_leg_to_the_waypoint_is_left_out(planner):
    printed = WaypointPlanner(
        robot=ROBOT, network=planner.network, dt=0.1, delta=planner.delta, as_printed=True
    )
    (journey,) = drive([world(disc((2.0, 0.2), 0.3), sensor=1.0)], printed, safety_filter=None)
    jumps = [np.linalg.norm(plan[:2, 0] - q) for plan, q in zip(journey.plans, journey.q[:2].T)]
    assert max(jumps) > 0.3  # it plans from where it is not
