"""What is driven of the plans T_0, T_1, ... where obstacles appear."""

from functools import cache

import numpy as np
import pytest
from closed_chains import CAR, closed_chain

from ann_dc.paper.around import around, driven, obstacles
from ann_dc.paper.replans import CASES, Case, replanned


@cache
def planned(number: int):
    return replanned(closed_chain(CAR), CAR, CASES[number])


@pytest.mark.parametrize(
    "number", [0, *(pytest.param(n, marks=pytest.mark.slow) for n in range(1, len(CASES)))]
)
def test_what_is_driven_meets_no_obstacle_and_ends_at_the_target(number):
    plans = planned(number)
    pieces = driven(plans)
    assert len(pieces) == len(plans.starts)
    share = np.linspace(0.0, 1.0, 50)
    for piece, start in zip(pieces, plans.starts):
        assert piece.q.shape[1] == piece.u.shape[1] + 1
        np.testing.assert_allclose(piece.q[:, 0], start, atol=1e-6)
        for a, b in zip(piece.q[:2].T, piece.q[:2].T[1:]):
            way = a + share[:, None] * (b - a)
            apart = np.linalg.norm(way[:, None] - obstacles(plans), axis=2)
            assert apart.min() > 0.35
    np.testing.assert_allclose(pieces[-1].q[:, -1], CAR.q_d, atol=1e-6)


def test_obstacles_stand_on_the_plan_that_knows_none():
    plans = planned(1)
    np.testing.assert_array_equal(obstacles(plans)[0], plans.states[0, :2, 3])
    assert obstacles(plans).shape == (3, 2)


def test_controls_are_those_of_the_pieces():
    plans = planned(0)
    for piece in driven(plans):
        states = CAR.functions.rollout(piece.q[:, 0], piece.u)
        np.testing.assert_allclose(states, piece.q, atol=1e-6)


def test_a_plan_that_meets_no_new_obstacle_is_driven_to_its_end():
    """T_1 begins 0.85 m aside and passes the second obstacle out of sight."""
    case = Case(name="aside", stages=(2, 5), delta=(-0.6, 0.6, 0.0, 0.0))
    plans = replanned(closed_chain(CAR), CAR, case)
    pieces = driven(plans)
    assert [piece.u.shape[1] for piece in pieces] == [1, 9]
    np.testing.assert_allclose(pieces[-1].q[:, -1], CAR.q_d, atol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize(
    "number", [1, *(pytest.param(n, marks=pytest.mark.slow) for n in range(len(CASES) - 1))]
)
def test_ways_that_can_be_driven_are_clear_along_whole_segments(number):
    found = around(planned(number), CAR)
    assert all(segment.certified for segment in found.segments)
    assert found.discs.certified
    assert found.discs.status.settled
    centres, share = obstacles(found.plans), np.linspace(0.0, 1.0, 200)[:, None, None]
    for way in found.ways.values():
        np.testing.assert_allclose(way.q[:, 0], CAR.q_0, atol=1e-6)
        np.testing.assert_allclose(way.q[:, -1], CAR.q_d, atol=1e-6)
        led = CAR.functions.rollout(way.q[:, 0], way.u)
        np.testing.assert_allclose(led, way.q, atol=1e-6)
        points = way.q[:2, :-1].T + share * np.diff(way.q[:2]).T
        apart = np.linalg.norm(points[:, :, None] - centres, axis=-1).min()
        assert 0 < found.room(way) <= apart - 0.25 + 1e-12
        assert found.room(way) == pytest.approx(apart - 0.25, abs=1e-3)
