"""Is the largest objective minimised? Shares that are wrong are told, one way or another."""

from dataclasses import replace

import numpy as np
import pytest
from minimax import small

import ann_dc
from ann_dc.errors import ArgumentValueError
from ann_dc.evaluation.populations import kkt_point
from ann_dc.optimality.certificate import certify
from ann_dc.optimality.complementarity import Largest


@pytest.fixture(scope="module")
def point():
    """A problem whose optimum weighs both objectives, and its KKT point."""
    problem = small(12)
    solution = ann_dc.solve(problem)
    return problem, kkt_point(solution.network, solution.trajectory.final), solution


def test_values_and_shares_are_told(point):
    problem, settled, solution = point
    largest = certify(problem, *settled).largest
    assert not largest.reason
    assert largest.shares.min() > 0.01
    assert largest.values[0] == pytest.approx(largest.values[1], abs=1e-6)
    assert abs(largest.excess) < 1e-6
    assert "effort" in str(solution)
    assert solution.as_dict()["objectives"]["error"]["share"] == largest.shares[1]


@pytest.mark.parametrize(
    ("shares", "reason"),
    [
        ((1.1, 1.0), "weights of the objectives differ from a sum of one"),
        ((1.0, 0.9), "weights of the objectives differ from a sum of one"),
    ],
)
def test_shares_add_up_to_one(point, shares, reason):
    problem, settled, _ = point
    found = certify(problem, *settled[:-1], settled[-1] * shares).largest
    assert found.reason
    assert reason in found.reason


def test_a_share_is_not_negative(point):
    problem, settled, _ = point
    found = certify(problem, *settled[:-1], np.array([1.2, -0.2])).largest
    assert found.miss == pytest.approx(0.2)
    assert found.reason


def test_only_the_largest_has_a_share(point):
    problem, (q, u, *duals), _ = point
    found = certify(problem, q, 1.1 * u, *duals).largest
    assert found.values[0] > found.values[1]
    assert "an objective with a positive weight is below the largest" in found.reason


def test_other_shares_are_another_optimum(point):
    problem, settled, _ = point
    certificate = certify(problem, *settled[:-1], np.array([0.5, 0.5]))
    assert not certificate.largest.reason
    assert not certificate.certified
    assert "KKT residual" in certificate.reason
    assert not certify(problem, *settled[:-1]).certified


def test_at_a_temperature_shares_are_exponentials():
    values, T = np.array([1.0, 1.2, -3.0]), 0.1
    shares = np.exp(values / T) / np.exp(values / T).sum()
    largest = Largest(names=("a", "b", "c"), values=values, shares=shares, size=1.0, temperature=T)
    assert largest.level == pytest.approx(T * np.log(np.exp(values / T).sum()))
    assert not largest.reason
    assert largest.excess == pytest.approx(-T * shares @ np.log(shares))
    moved = replace(largest, shares=shares + np.array([1e-3, -1e-3, 0]))
    assert moved.miss < 1e-12
    assert "differs from the value of its weight" in moved.reason
    assert replace(largest, values=np.array([1.0, 1.2, -9e9])).product < 1e-6


def test_shares_have_a_shape(point):
    problem, settled, _ = point
    with pytest.raises(ArgumentValueError, match="shares"):
        certify(problem, *settled[:-1], np.ones(3))
