"""The shield: good plans pass, others are replaced by what leaves more room."""

import numpy as np
import pytest

from ann_dc.navigation.obstacles import disc
from ann_dc.navigation.planner import Plan, Situation
from ann_dc.navigation.safety_filter import SafetyFilter
from ann_dc.navigation.scenario import Scenario
from ann_dc.problem.robot import car_robot, unicycle_robot

ROBOT = unicycle_robot(reverse=1.0, radius=0.2)


def situation(*obstacles):
    world = Scenario(robot=ROBOT, start=np.zeros(3), goal=np.array([5.0, 0.0]), obstacles=obstacles)
    return Situation(world, 0, world.start, 0.0)


def plan(speed, residual=1e-4):
    u = np.tile([[speed], [0.0]], 10)
    return Plan(q=ROBOT.steps(0.1).rollout(np.zeros(3), u), u=u, residual=residual)


def test_a_plan_with_room_passes():
    assert SafetyFilter().instead(situation(disc((3, 1), 0.5)), plan(1.0), 0.1) is None
    assert SafetyFilter().instead(situation(), plan(1.0, residual=np.inf), 0.1) is None


def test_a_robot_about_to_collide_does_something_else():
    here = situation(disc((1.2, 0), 0.5))
    u = SafetyFilter().instead(here, plan(2.0), 0.1)
    assert u is not None
    assert u[0] <= 0
    way = ROBOT.steps(0.1).rollout(np.zeros(3), np.tile(u[:, None], 8))
    assert here.world.obstacles[0].near(way[:2].T, np.zeros(9)).distance.min() > 0.4


def test_it_gives_way_to_what_comes():
    """Standing still would not do: a disc comes along the way."""
    u = SafetyFilter().instead(situation(disc((1.4, 0), 0.5, velocity=(-1.0, 0.0))), plan(0.0), 0.1)
    assert u is not None
    assert u[0] == -1.0


def least_room(here, u):
    """Least room of a way with constant controls, over the shield's steps."""
    way = ROBOT.steps(0.1).rollout(np.zeros(3), np.tile(u[:, None], 8))[:, 1:]
    times = 0.1 * np.arange(1, 9)
    gaps = [o.near(way[:2].T, times).distance.min() for o in here.world.obstacles]
    return min(gaps) - ROBOT.radius


def test_it_moves_gently_where_there_is_little_room():
    """A slow disc in front, others around: a way out at full speed hits one of them."""
    around = [disc(centre, 0.5) for centre in ((-1.1, 0), (-0.4, 0.85), (-0.4, -0.85))]
    here = situation(disc((0.8, 0), 0.5, velocity=(-0.2, 0.0)), *around)
    u = SafetyFilter().instead(here, plan(0.0), 0.1)
    assert u is not None
    assert -0.5 < u[0] < 0
    assert least_room(here, u) > 0.05
    fast = [least_room(here, np.array([v, w])) for v in (-1.0, 0.0, 2.0) for w in (-3.0, 0.0, 3.0)]
    assert max(fast) < 0


def test_a_plan_that_is_none_is_not_trusted():
    here = situation(disc((3, 1), 0.5))
    assert SafetyFilter().instead(here, plan(1.0, residual=0.5), 0.1) is not None
    assert SafetyFilter(trusted=1.0).instead(here, plan(1.0, residual=0.5), 0.1) is None


def test_robot_that_would_stand_takes_the_first_step_of_a_plan_with_a_way_out_behind_it():
    """A plan that ends in a disc 1.5 ahead: no way out is better than standing, none is needed."""
    robot = unicycle_robot(radius=0.2)  # it cannot reverse
    here = Scenario(
        robot=robot, start=np.zeros(3), goal=np.array([5.0, 0.0]), obstacles=(disc((1.5, 0), 0.5),)
    )
    u = np.tile([[2.0], [0.0]], 10)
    plan = Plan(q=robot.steps(0.1).rollout(here.start, u), u=u, residual=0.0)
    assert SafetyFilter().instead(Situation(here, 0, here.start, 0.0), plan, 0.1) is None
    near = Situation(here, 0, np.array([0.55, 0.0, 0.0]), 0.0)  # 0.25 of room, 0.05 after a period
    held = SafetyFilter().instead(near, plan, 0.1)
    assert held is not None
    assert held[0] == 0.0
    doubtful = Plan(q=plan.q, u=u, residual=0.5)
    assert SafetyFilter().instead(Situation(here, 0, here.start, 0.0), doubtful, 0.1) is not None


@pytest.mark.parametrize("eta", [-3.0, 3.0])
def test_ways_out_of_a_car_turn_as_far_as_its_steering_allows(eta):
    """With steering beyond its limit, a car would circle within less room than it needs."""
    robot = car_robot(steering=0.3)
    here = Scenario(
        robot=robot,
        start=np.array([0.0, 0.0, 0.0, 0.3 * np.sign(eta)]),
        goal=np.array([5.0, 0.0]),
        obstacles=(disc((2.0, 0.0), 0.5),),
    )
    situation = Situation(here, 0, here.start, 0.0)
    _, ways, _ = SafetyFilter()._ways_out(situation, here.start[:, None], 0.1)
    assert np.abs(ways[:, 3]).max() == pytest.approx(0.3)
