"""Half-planes: what lies beyond them is free of the obstacle, and they lead past it on one side."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from ann_dc.navigation.half_planes import Ahead, Margin, discs, half_planes
from ann_dc.navigation.obstacles import disc, polygon
from ann_dc.problem.robot_planning import LINEAR, NONLINEAR

STAGES = 12
GOAL = np.array([5.0, 0.0])


def ahead(path, between=0.1):
    return Ahead(
        path=np.asarray(path, float), goal=GOAL, time=0.1 * np.arange(len(path)),
        room=np.full(len(path), 0.25), between=between,
    )  # fmt: skip


def line(height):
    return np.column_stack([np.linspace(0, 4, STAGES), np.full(STAGES, height)])


places = st.tuples(st.floats(-1, 5), st.floats(-2, 2))


@settings(deadline=None)
@given(places, st.floats(0.2, 0.8), places, st.floats(-2, 2))
def test_beyond_a_half_plane_there_is_room(centre, radius, velocity, height):
    """Whatever the path before: a node that keeps its row keeps off the obstacle."""
    stone = disc(centre, radius, velocity=np.array(velocity) / 10)
    corners = [(0, 0), (1, 0), (0.8, 0.7)]
    block = polygon(np.array(corners) + centre, velocity=np.array(velocity) / 10)
    for obstacle in (stone, block):
        way = ahead(line(height))
        rows = half_planes([(0, obstacle)], way, 1, {})[:, 0]
        normal, b = rows[:, :2], rows[:, 2]
        np.testing.assert_allclose(np.linalg.norm(normal, axis=1), 1)
        on_it = b[:, None] * normal + 0.7 * np.column_stack([-normal[:, 1], normal[:, 0]])
        assert (obstacle.near(on_it, way.time).distance >= way.room - 1e-9).all()


def test_a_disc_is_where_its_obstacle_will_be_and_as_wide():
    """A node on the rim of the disc keeps off the obstacle; off a disc by exactly its room."""
    stone = disc((2, 0), 0.5, velocity=(0, 0.3))
    block = polygon([(1, 0), (2, 0), (1.8, 0.7)], velocity=(-0.2, 0))
    way = ahead(line(0.2), between=0.0)
    rows = discs([(0, stone), (1, block)], way, 3, {})
    np.testing.assert_array_equal(rows[:, 2], np.tile(NONLINEAR.nowhere, (STAGES, 1)))
    for obstacle in (stone, block):
        own = np.abs(rows[:, :2, :2] - obstacle.centres(way.time)[:, None]).sum(axis=2).argmin(1)
        centre, reach = np.split(rows[np.arange(STAGES), own], [2], axis=1)
        for angle in np.linspace(0, 2 * np.pi, 17):
            on_it = centre + reach * [np.cos(angle), np.sin(angle)]
            spare = obstacle.near(on_it, way.time).distance - way.room
            assert (spare >= -1e-9).all()
            if obstacle is stone:
                np.testing.assert_allclose(spare, 0, atol=1e-9)


@pytest.mark.parametrize("height", [0.2, -0.2])
def test_an_obstacle_on_the_way_is_passed_on_the_nearer_side(height):
    """The robot is above its centre: above it is passed, by all cells beside it."""
    sides = {}
    rows = half_planes([(7, disc((2, 0), 0.5))], ahead(line(height)), 2, sides)
    assert sides == {7: np.sign(height)}
    beside = np.abs(np.linspace(0, 4, STAGES) - 2) < 0.5
    assert (rows[beside, 0, 1] * np.sign(height) > 0.5).all()
    np.testing.assert_array_equal(rows[:, 1], np.tile(LINEAR.nowhere, (STAGES, 1)))


def test_a_side_is_kept_while_the_path_crosses_and_then_forgotten():
    stone, sides = disc((2, 0), 0.5), {0: -1.0}
    half_planes([(0, stone)], ahead(line(0.2)), 1, sides)
    assert sides == {0: -1.0}
    half_planes([(0, stone)], ahead(line(1.5)), 1, sides)
    assert sides == {}


def test_the_nearest_obstacles_get_the_slots():
    near, far = disc((2, 0.6), 0.3), disc((2, 5), 0.3)
    rows = half_planes([(0, far), (1, near)], ahead(line(0.0)), 1, {})
    np.testing.assert_allclose(rows, half_planes([(1, near)], ahead(line(0.0)), 1, {}))


def test_margins_grow_with_the_stages():
    room = Margin(near=0.1, far=0.3, stages=4).at(8)
    np.testing.assert_allclose(room, [0.1, 0.15, 0.2, 0.25, 0.3, 0.3, 0.3, 0.3])
