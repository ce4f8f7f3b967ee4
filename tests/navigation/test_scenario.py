"""Worlds: what is in sight, how much room there is, and what is refused."""

import numpy as np
import pytest
from seeds import seeds

from ann_dc.errors import ScenarioError
from ann_dc.navigation.obstacles import disc
from ann_dc.navigation.scenario import Scenario, random_scenario
from ann_dc.problem.robot import car_robot, unicycle_robot


def world(obstacles, **given):
    return Scenario(
        robot=unicycle_robot(radius=0.2), start=np.zeros(3), goal=np.array([4.0, 0.0]),
        obstacles=tuple(obstacles), **given,
    )  # fmt: skip


def test_what_appears_later_is_not_seen_before():
    yard = world([disc((2, 1), 0.5, appears=1.0), disc((3.5, -2), 0.5)], sensor=2.5)
    assert yard.sensed(np.zeros(2), 0.0) == []
    assert yard.sensed(np.zeros(2), 1.0) == [0]
    assert yard.sensed(np.array([3.0, 0.0]), 1.0) == [0, 1]


def test_room_is_from_rim_to_rim_and_of_what_is_there():
    yard = world([disc((2, 1), 0.5), disc((2, -0.8), 0.5, appears=5.0)])
    places = np.array([[0.0, 0.0], [2.0, 0.0]])
    assert yard.clearance(places, np.array([0.0, 1.0])) == pytest.approx(1 - 0.5 - 0.2)
    assert yard.clearance(places, np.array([0.0, 5.0])) == pytest.approx(0.8 - 0.5 - 0.2)
    assert world([]).clearance(places, np.zeros(2)) == np.inf


@pytest.mark.parametrize(
    ("obstacle", "words"),
    [
        (disc((0.3, 0), 0.2), r"start: the robot \(radius 0\.2\) overlaps by 0.1 with"),
        (disc((4.1, 0), 0.2), r"goal: .* obstacles\[0\]"),
    ],
)
def test_start_and_goal_have_to_be_free(obstacle, words):
    with pytest.raises(ScenarioError, match=words):
        world([obstacle])


def test_where_something_moves_through_or_appears_may_be_a_goal():
    world([disc((4.1, 0), 0.2, velocity=(1, 0)), disc((4.1, 0), 0.2, appears=2.0)])


@pytest.mark.parametrize(
    ("field", "value", "words"),
    [
        ("start", [0, 0], "start: expected 3 finite numbers"),
        ("start", "here", "start: expected a list of numbers"),
        ("goal", [np.nan, 0], "goal: expected 2 finite numbers"),
    ],
)
def test_bad_places_are_refused(field, value, words):
    given = {"start": np.zeros(3), "goal": np.array([4.0, 0.0]), field: value}
    with pytest.raises(ScenarioError, match=words):
        Scenario(robot=unicycle_robot(), **given)


@seeds(20)
def test_random_worlds_leave_room(seed):
    found = random_scenario(seed)
    assert 3 <= len(found.obstacles) <= 8
    discs = [(o.centre, o.radius) for o in found.obstacles]
    for i, (centre, radius) in enumerate(discs):
        for other, its in discs[:i]:
            assert np.linalg.norm(centre - other) >= radius + its + 0.35 - 1e-12
    again = random_scenario(seed, robot=car_robot(reverse=1.0))
    for one, other in zip(found.obstacles, again.obstacles):
        np.testing.assert_array_equal(one.corners, other.corners)
