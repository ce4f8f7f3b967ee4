"""Obstacles: how near they are and how far they reach, against closed forms and SciPy."""

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy.optimize import minimize

from ann_dc.errors import ScenarioError
from ann_dc.navigation.obstacles import disc, polygon

coordinate = st.floats(-5, 5)
places = st.tuples(coordinate, coordinate)
NOW = np.zeros(1)


def nearest(corners, place):
    """The nearest point of a hull: shares of its corners, by SLSQP."""
    shares = np.full(len(corners), 1 / len(corners))
    found = minimize(
        lambda w: ((w @ corners - place) ** 2).sum(), shares, bounds=[(0, 1)] * len(corners),
        constraints={"type": "eq", "fun": lambda w: w.sum() - 1}, method="SLSQP",
        options={"ftol": 1e-14, "maxiter": 300},
    )  # fmt: skip
    return found.x @ corners


@given(places, st.floats(0.1, 2), places, places, st.floats(0, 3))
def test_a_disc_is_as_near_as_its_rim(centre, radius, velocity, place, time):
    stone = disc(centre, radius, velocity=velocity)
    found = stone.near(np.array([place]), np.array([time]))
    offset = np.subtract(place, centre) - time * np.array(velocity)
    assert found.distance[0] == pytest.approx(np.linalg.norm(offset) - radius, abs=1e-9)
    assert np.linalg.norm(found.normal[0]) == pytest.approx(1)
    if np.linalg.norm(offset) > 1e-6:
        np.testing.assert_allclose(found.normal[0], offset / np.linalg.norm(offset), atol=1e-9)


BLOCK = np.array([(1, 0), (3, 1), (2.5, 2.5), (0.5, 2)], float)


@given(places)
def test_a_polygon_is_as_near_as_its_nearest_point(place):
    place = np.array(place)
    found, foot = polygon(BLOCK).near(place[None], NOW), nearest(BLOCK, place)
    apart = np.linalg.norm(place - foot)
    if apart > 1e-3:
        assert found.distance[0] == pytest.approx(apart, abs=1e-4)
        np.testing.assert_allclose(found.normal[0], (place - foot) / apart, atol=1e-2)
    else:
        assert found.distance[0] < 2e-3


def test_inside_a_polygon_the_nearest_side_counts():
    found = polygon([(0, 0), (4, 0), (4, 2), (0, 2)]).near(np.array([[1.0, 1.8]]), NOW)
    assert found.distance[0] == pytest.approx(-0.2)
    np.testing.assert_allclose(found.normal[0], [0, 1])


@given(st.floats(0, 2 * np.pi), places)
def test_a_half_plane_at_its_reach_holds_no_point_of_it(angle, place):
    """What lies beyond the tangent is free, whatever its direction."""
    direction = np.array([[np.cos(angle), np.sin(angle)]])
    for obstacle in (polygon(BLOCK), disc((1, 2), 0.7)):
        beyond = (np.array(place) - obstacle.centre) @ direction[0] - obstacle.reach(direction)[0]
        if beyond > 0:
            assert obstacle.near(np.array([place]), NOW).distance[0] >= beyond - 1e-9


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: disc((0, 0), 0.0), "radius: expected a positive number, got 0.0"),
        (lambda: disc((0, 0), float("nan")), "radius"),
        (lambda: disc((0, 0, 0), 1.0), r"centre: expected two finite numbers \(x, y\)"),
        (lambda: disc((0, 0), 1.0, velocity=("fast", 0)), "velocity"),
        (lambda: disc((0, 0), 1.0, appears=float("inf")), "appears"),
        (lambda: polygon([(0, 0), (1, 1)]), "corners: expected three or more, got 2"),
        (lambda: polygon([(0, 0), (1, 1), (2, 2)]), "on one line"),
        (lambda: polygon([(0, 0), (2, 0), (1, 0.5), (1, 2)]), "not convex"),
    ],
)
def test_bad_input_is_refused(make, words):
    with pytest.raises(ScenarioError, match=words):
        make()
