"""Fronts of objectives: every point certified, and where IPOPT finds it."""

import numpy as np
import pytest
import sympy as sp
from minimax import OBJECTIVES, car, epigraph, small

import ann_dc
from ann_dc import plotting
from ann_dc.errors import ProblemError


@pytest.fixture(scope="module")
def front():
    return ann_dc.pareto(car({n: OBJECTIVES[n] for n in ("effort", "length")}), points=7)


@pytest.mark.slow
def test_every_point_is_that_of_ipopt(front):
    assert front.certified.all()
    for weights, values, certificate in zip(front.weights, front.values, front.certificates):
        inputs = {f"weight_{name}": w for name, w in zip(front.names, weights)}
        known = epigraph(front.problem.with_inputs(**inputs))
        related = known.values / weights
        expected = front.ideal + related * (front.nadir - front.ideal)
        np.testing.assert_allclose(values, expected, rtol=1e-6)
        np.testing.assert_allclose(certificate.largest.shares, known.shares, atol=5e-5)


@pytest.mark.slow
def test_no_point_is_better_in_everything(front):
    order = np.argsort(front.values[:, 0])
    assert (np.diff(front.values[order, 0]) > 0).all()
    assert (np.diff(front.values[order, 1]) < 0).all()
    assert (front.values > front.ideal).all()
    assert (front.values < front.nadir).all()
    np.testing.assert_allclose(front.weights.sum(axis=1), 1.0)
    np.testing.assert_allclose(front.shares.sum(axis=1), 1.0)


@pytest.mark.slow
def test_it_tells_itself_and_is_drawn(front):
    assert "7 of 7 points of the front certified" in str(front)
    assert len(str(front).splitlines()) == 4 + 7
    assert front.states(0).shape == (4, 13)
    assert front.controls(0).shape == (2, 12)
    plane, shares = plotting.front(front).axes
    assert plane.get_xlabel() == "effort"
    assert len(shares.patches) == 2 * 7


@pytest.mark.slow
def test_three_objectives_and_weights_of_ones_own():
    front = ann_dc.pareto(car(OBJECTIVES), points=[[0.2, 0.3, 0.5], [0.6, 0.2, 0.2]])
    assert front.certified.all()
    assert front.values.shape == (2, 3)
    assert len(plotting.front(front).axes) == 4


@pytest.mark.slow
def test_points_of_three_objectives_divide_a_triangle():
    front = ann_dc.pareto(small(4), points=2)
    np.testing.assert_allclose(front.weights, [[0.25, 0.75], [0.75, 0.25]])


x, a = sp.symbols("x a")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"points": 0}, "points: expected a number of points"),
        ({"points": [[0.5, 0.6]]}, "add up to 1.1"),
        ({"points": [[1.0, 0.0]]}, "points: weights of a front are positive"),
        ({"points": [0.5, 0.5]}, "points: expected a number of points, or an array"),
        ({"points": "many"}, "points: expected"),
    ],
)
def test_points_are_refused_by_name(change, message):
    with pytest.raises(ProblemError, match=message):
        ann_dc.pareto(small(), **change)


def test_a_front_is_of_objectives_alone():
    with pytest.raises(ProblemError, match="has none; a front needs two or more"):
        ann_dc.pareto(ann_dc.plants.double_integrator(N=3))
    with pytest.raises(ProblemError, match="cost: a front has objectives only"):
        ann_dc.pareto(small(cost=a**2))
