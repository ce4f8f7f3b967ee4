"""The planning problem: linear about a path, and its inputs say about which."""

import numpy as np
import pytest

from ann_dc.problem.robot import car_robot, unicycle_robot
from ann_dc.problem.robot_planning import LINEAR, NONLINEAR, planning_problem, segment_problem
from ann_dc.problem.soft import Soft

SOFT = Soft(weight=100.0, compliance=0.001)


def planning(robot, form=LINEAR):
    return planning_problem(
        robot, horizon=5, dt=0.1, slots=2, pull=0.1, reach=2.0, soft=SOFT, form=form
    )


def path(robot, stages, seed=0):
    draws = np.random.default_rng(seed)
    q = draws.uniform(-0.5, 0.5, (len(robot.states), stages))
    u = draws.uniform(-0.5, 0.5, (len(robot.controls), stages))
    u[0] = 1.5
    return q, u


def with_inputs(found, values):
    symbols = {str(symbol): symbol for symbol in found.problem.inputs}
    given = {symbol: np.zeros(found.problem.horizon) for symbol in found.problem.inputs}
    given |= {symbols[name]: value for name, value in values.items()}
    return found.problem.functions.with_inputs(given)


@pytest.mark.sampled(1)
@pytest.mark.parametrize("robot", [car_robot(), unicycle_robot()], ids=["car", "unicycle"])
def test_about_its_path_the_map_is_the_robots(robot):
    found = planning(robot)
    q, u = path(robot, 5)
    own, linear = robot.steps(0.1), with_inputs(found, found.model_inputs(q, u))
    np.testing.assert_allclose(linear.map(q, u), own.map(q, u), atol=1e-12)
    for mine, its in zip(linear.map_jacobian(q, u), own.map_jacobian(q, u)):
        np.testing.assert_allclose(mine, its, atol=1e-12)
    off = 1e-4
    apart = np.abs(linear.map(q + off, u) - own.map(q + off, u)).max()
    assert apart < 10 * off**2


@pytest.mark.slow
def test_a_car_that_stands_is_linearised_about_one_that_rolls():
    robot = car_robot(reverse=1.0)
    found = planning(robot)
    q, u = path(robot, 5)
    rolling = found.model_inputs(q, np.vstack([np.full(5, 1.0), u[1]]))
    for speed in (0.0, 0.4, -0.4):
        slow = found.model_inputs(q, np.vstack([np.full(5, speed), u[1]]))
        np.testing.assert_array_equal(slow["phi_by_varphi"], rolling["phi_by_varphi"])
    back = found.model_inputs(q, np.vstack([np.full(5, -0.8), u[1]]))
    assert (back["phi_by_varphi"] < 0).all()


@pytest.mark.slow
def test_a_path_beyond_the_limits_is_linearised_at_them():
    robot = car_robot(reverse=1.0)
    found = planning(robot)
    q, u = path(robot, 5)
    steered, limited = q.copy(), q.copy()
    steered[3], limited[3] = 1.5, robot.state_limits[3, 1]
    beyond, at = (found.model_inputs(reference, u) for reference in (steered, limited))
    for name, value in at.items():
        np.testing.assert_array_equal(beyond[name], value)


def test_slots_are_half_planes():
    found = planning(unicycle_robot())
    rows = np.tile([0.6, 0.8, 1.0], (5, 2, 1))
    q, u = path(unicycle_robot(), 5)
    functions = with_inputs(found, found.slot_inputs(rows))
    expected = 1 - 0.6 * q[0] - 0.8 * q[1]
    np.testing.assert_allclose(functions.rows(q, u).value[:2], [expected, expected])


def test_nonlinear_cells_hold_the_robots_own_map_and_discs():
    robot = car_robot()
    found = planning(robot, NONLINEAR)
    q, u = path(robot, 5)
    assert found.model_inputs(q, u) == {}
    functions = with_inputs(found, found.slot_inputs(np.tile([2.0, 1.0, 0.5], (5, 2, 1))))
    np.testing.assert_allclose(functions.map(q, u), robot.steps(0.1).map(q, u))
    distance = np.hypot(q[0] - 2, q[1] - 1)
    expected = (0.5 - distance) * (0.5 + distance) / (2 * 0.5)
    np.testing.assert_allclose(functions.rows(q, u).value[:2], [expected, expected])


def test_samples_are_told_apart():
    robot = car_robot()
    found = planning(robot)
    paths = [path(robot, 5, seed) for seed in range(3)]
    q, u = (np.stack(parts, axis=1) for parts in zip(*paths))
    together = found.model_inputs(q, u)
    for sample, (one_q, one_u) in enumerate(paths):
        for name, value in found.model_inputs(one_q, one_u).items():
            np.testing.assert_allclose(together[name][sample], value)


def test_a_leg_has_a_time_of_its_own():
    problem = segment_problem(unicycle_robot(), stages=6, reach=2.0)
    (h,) = problem.inputs
    q, u = path(unicycle_robot(), 6)
    for step in (0.05, 0.2):
        functions = problem.functions.with_inputs({h: np.full(6, step)})
        np.testing.assert_allclose(functions.map(q, u), unicycle_robot().steps(step).map(q, u))
