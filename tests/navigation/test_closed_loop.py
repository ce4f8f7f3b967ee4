"""The closed loop, with a planner whose answers are known."""

import numpy as np
import pytest

from ann_dc.navigation.closed_loop import ClosedLoopRun, drive
from ann_dc.navigation.obstacles import disc
from ann_dc.navigation.planner import Plan
from ann_dc.navigation.scenario import Scenario
from ann_dc.problem.robot import unicycle_robot

ROBOT = unicycle_robot(radius=0.2)


class Straight:
    """Full speed ahead, and nothing else."""

    dt = 0.1

    def begin(self):
        return self

    def plan(self, situations):
        u = np.tile([[2.0], [0.0]], 10)
        return [Plan(q=ROBOT.steps(0.1).rollout(s.q, u), u=u, residual=0.0) for s in situations]


def world(*obstacles, **given):
    start, goal = np.zeros(3), np.array([3.0, 0.0])
    return Scenario(robot=ROBOT, start=start, goal=goal, obstacles=obstacles, **given)


def test_a_free_way_is_driven():
    (journey,) = drive([world()], Straight())
    assert (journey.arrived, journey.collided) == (True, False)
    assert journey.length == pytest.approx(2.8, abs=0.21)  # it is there 0.3 before the goal
    np.testing.assert_allclose(journey.q[1:], 0, atol=1e-12)
    np.testing.assert_allclose(np.diff(journey.q[0]), 0.2)
    assert journey.effort == pytest.approx(0.1 * 4 * journey.u.shape[1])
    assert "reached the goal after 1.4 s" in str(journey)


def test_a_collision_between_two_instants_is_seen():
    """A small disc stands between two of the nodes, beside the way."""
    post = disc((1.1, 0.21), 0.02)
    (journey,) = drive([world(post)], Straight(), safety_filter=None)
    assert journey.collided
    assert journey.clearance.min() == pytest.approx(0.21 - 0.2 - 0.02, abs=1e-6)
    assert "collided" in str(journey)


def test_the_shield_keeps_it_from_a_wall():
    (journey,) = drive([world(disc((1.6, 0), 0.5), duration=2.0)], Straight())
    assert (journey.arrived, journey.collided) == (False, False)
    assert journey.shielded.any()
    assert "not reached" in str(journey)


def test_robot_before_a_wall_is_told_to_be_held_by_the_safety_filter():
    (held,) = drive([world(disc((1.6, 0), 0.5), duration=4.0)], Straight())
    assert held.held
    assert "not reached, stopped by the safety filter after 4.0 s" in str(held)
    assert held.clearance.min() >= 0.05
    (late,) = drive([world(duration=0.5)], Straight())  # on its way, without an obstacle
    assert not late.held
    (hit,) = drive([world(disc((1.6, 0), 0.5), duration=4.0)], Straight(), safety_filter=None)
    assert not hit.held


def test_no_journey_depends_on_another():
    worlds = [world(), world(disc((1.6, 0), 0.5), duration=1.5)]
    together = drive(worlds, Straight())
    for one, alone in zip(together, (drive([w], Straight())[0] for w in worlds)):
        np.testing.assert_array_equal(one.q, alone.q)


def test_controls_stay_within_the_limits():
    class Wild(Straight):
        def plan(self, situations):
            u = np.tile([[50.0], [-50.0]], 10)
            return [Plan(q=np.zeros((3, 11)), u=u) for _ in situations]

    (journey,) = drive([world(duration=0.5)], Wild())
    assert isinstance(journey, ClosedLoopRun)
    np.testing.assert_array_equal(journey.u, np.tile([[2.0], [-2.5]], 5))
