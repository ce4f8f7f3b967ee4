"""The planning network: its plans against IPOPT's, and a robot that drives with it."""

from dataclasses import replace

import numpy as np
import pytest
from reference import ipopt

from ann_dc.errors import DesignError
from ann_dc.hardware.circuit.scaling import ProbeRun, ScalingRules, scale
from ann_dc.navigation.closed_loop import drive
from ann_dc.navigation.half_planes import Margin
from ann_dc.navigation.obstacles import disc
from ann_dc.navigation.planner import Situation
from ann_dc.navigation.planner_design import design_planner, planner_for
from ann_dc.navigation.scenario import Scenario, random_scenario
from ann_dc.problem.robot import car_robot, unicycle_robot
from ann_dc.problem.robot_planning import NONLINEAR, planning_problem
from ann_dc.problem.soft import Soft

ROBOT = unicycle_robot(reverse=0.5)


def world(*obstacles, goal=(3.0, 0.0), **given):
    start = np.array([0.0, 0.0, 0.2])
    return Scenario(robot=ROBOT, start=start, goal=np.array(goal), obstacles=obstacles, **given)


TRAINING = [world(disc((1.4, y), 0.3), duration=2.5) for y in (0.25, -0.3)]


@pytest.fixture(scope="module")
def planner():
    return design_planner(ROBOT, horizon=10, dt=0.15, slots=1, worlds=TRAINING)


@pytest.mark.slow
def test_a_robot_gets_round_what_stands_in_its_way(planner):
    (journey,) = drive([world(disc((1.5, -0.1), 0.35))], planner)
    assert (journey.arrived, journey.collided) == (True, False)
    assert journey.relative_multiplier.max() > 0.01  # it was a contact
    assert np.median(journey.residuals) < 1e-3
    assert (journey.spent <= planner.budget + 1e-6).all()


def test_a_plan_is_the_optimum_of_what_the_network_was_told(planner):
    """IPOPT's optimum of the same problem with the inputs of the moment, in contact."""
    planner = replace(planner, tolerance=1e-8, budget=5000.0)
    yard = world(disc((1.3, -0.1), 0.35))
    driver = planner.begin()
    plan = driver.plan([Situation(yard, 0, yard.start, 0.0)])[0]
    reported = {name: values[0] for name, values in driver.batch.inputs.items()}
    problem = planner.planning.problem
    inputs = {symbol: reported[str(symbol)] for symbol in problem.inputs}
    exact = ipopt(replace(problem, inputs=inputs, q_0=yard.start), guess=(plan.q, plan.u))
    assert plan.relative_multiplier > 1e-3
    assert plan.residual < 1e-7
    np.testing.assert_allclose(plan.u, exact.u, atol=1e-4)
    np.testing.assert_allclose(plan.q, exact.q, atol=1e-4)


def test_no_journey_depends_on_another(planner):
    worlds = [world(duration=0.6), world(disc((1.2, 0.1), 0.3), duration=0.6)]
    together = drive(worlds, planner)
    for one, alone in zip(together, (drive([w], planner)[0] for w in worlds)):
        np.testing.assert_array_equal(one.q, alone.q)


def test_less_time_leaves_more_residual(planner):
    yard = world(disc((1.5, 0.1), 0.35), duration=1.5)
    much, little = (
        drive([yard], replace(planner, budget=budget))[0].residuals[1:].max()
        for budget in (1000.0, 10.0)
    )
    assert much < little


def test_its_size_and_its_time_in_hardware_are_told(planner):
    planner = replace(planner, budget=500.0)
    assert planner.hardware_time(10e6) == pytest.approx(500 * 10 / (2 * np.pi * 10e6))
    words = str(planner)
    assert words.startswith(f"{planner.network.size} neurons in 10 cells, ")
    assert "79.6 us with op amps of 10 MHz, 0.05% of the control period" in words
    assert "a period of 1 ms needs 1.59 MHz" in words


def test_its_time_in_hardware_is_that_of_a_circuit_of_its_network(planner):
    probe = ProbeRun(
        states=planner.network.start_state[None], times=np.zeros(1), radius=planner.radius
    )
    built = scale(planner.network, probe, ScalingRules(gbw=3e6)).time
    budget = planner.budget / planner.radius  # units of network time
    assert planner.hardware_time(3e6) == pytest.approx(budget * built)


def test_a_price_has_to_be_finite():
    with pytest.raises(DesignError, match=r"soft: .* finite weight"):
        design_planner(ROBOT, soft=Soft(compliance=0.1))


def test_a_robot_that_touches_nothing_cannot_be_designed():
    with pytest.raises(DesignError, match="no contact with an obstacle"):
        design_planner(ROBOT, horizon=6, slots=1, worlds=[world(duration=0.5)])


@pytest.mark.slow
def test_nonlinear_cells_with_discs_drive_too():
    planning = planning_problem(
        ROBOT, horizon=10, dt=0.15, slots=1, pull=0.15, reach=1.5, form=NONLINEAR,
        soft=Soft(weight=100.0, compliance=0.002),
    )  # fmt: skip
    planner = planner_for(planning, worlds=TRAINING)
    (journey,) = drive([world(disc((1.5, -0.1), 0.35))], planner)
    assert (journey.arrived, journey.collided) == (True, False)
    assert journey.relative_multiplier.max() > 0.01


@pytest.mark.slow
def test_cars_get_through_worlds_of_discs():
    """Seeds that no design and no figure uses."""
    robot = car_robot(reverse=0.8)
    planner = design_planner(robot)
    worlds = [random_scenario(50_000 + i, robot=robot) for i in range(20)]
    journeys = drive(worlds, planner)
    assert sum(not journey.collided for journey in journeys) >= 19
    assert sum(journey.arrived for journey in journeys) >= 15


def test_margins_are_kept(planner):
    wide = replace(planner, margin=Margin(near=0.3, far=0.4))
    yard = world(disc((1.5, -0.1), 0.35))
    rooms = [drive([yard], p)[0].clearance.min() for p in (planner, wide)]
    assert rooms[1] > rooms[0] + 0.1
