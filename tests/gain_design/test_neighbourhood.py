"""The neighbourhood in which a network with the same constants settles."""

from dataclasses import replace

import pytest

from ann_dc import design, plants
from ann_dc.gain_design.gains import apply_gains
from ann_dc.gain_design.neighbourhood import SAMPLES, neighbourhood


@pytest.fixture(scope="module")
def designed():
    return design(plants.double_integrator(N=6))


def test_convex_problem_settles_from_every_sample(designed):
    found = neighbourhood(designed)
    assert found.starts == found.inputs == ((0.05, SAMPLES), (0.15, SAMPLES))
    assert "8 of 8 at 5% and 8 of 8 at 15% settle" in str(found)


def test_same_seed_draws_the_same_samples():
    car = design(plants.car())
    assert neighbourhood(car, seed=3) == neighbourhood(car, seed=3)


def test_network_with_penalties_below_the_threshold_settles_from_fewer_samples():
    car = design(plants.car())
    worse = replace(car.gains, rho=1e-3 * car.gains.rho)
    found = neighbourhood(replace(car, network=apply_gains(car.network, worse)))
    assert found.starts[0][1] < SAMPLES
