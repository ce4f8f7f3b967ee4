"""Robots: how they move, against SciPy's integrator, and what is no robot."""

import numpy as np
import pytest
import sympy as sp
from scipy.integrate import solve_ivp

from ann_dc.errors import AnnDcError, ScenarioError
from ann_dc.problem.robot import Robot, car_robot, unicycle_robot


def test_a_car_moves_as_its_equations_say():
    q, u = np.array([0.3, -0.2, 0.7, 0.2]), np.array([1.5, 0.8])

    def F(_, q):
        return [np.cos(q[2]) * u[0], np.sin(q[2]) * u[0], np.tan(q[3]) / 0.5 * u[0], u[1]]

    exact = solve_ivp(F, (0, 0.1), q, rtol=1e-11, atol=1e-12).y[:, -1]
    steps = [car_robot().steps(0.1 / n) for n in (1, 10)]
    coarse, fine = q[:, None], q[:, None]
    coarse = steps[0].map(coarse, u[:, None])
    for _ in range(10):
        fine = steps[1].map(fine, u[:, None])
    errors = [np.abs(found[:, 0] - exact).max() for found in (coarse, fine)]
    assert errors[0] < 2e-3
    assert errors[1] < 0.02 * errors[0]  # of second order


def test_limits_are_those_of_the_bounds():
    robot = car_robot(speed=3.0, reverse=1.0, steering=0.4)
    np.testing.assert_array_equal(robot.limits, [[-1, 3], [-3, 3]])
    np.testing.assert_array_equal(robot.state_limits[3], [-0.4, 0.4])
    assert np.isinf(robot.state_limits[:3]).all()


x, y, v = sp.symbols("x y v")


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"states": (x,), "dynamics": (v,)}, "states: expected x, y"),
        ({"bounds": {}}, "bounds: every control needs"),
        ({"dynamics": (v, 1 + v)}, "dynamics: expected a robot at rest if all controls are zero"),
    ],
)
def test_what_is_no_robot_is_refused(changes, words):
    given = {"states": (x, y), "controls": (v,), "dynamics": (v, v), "bounds": {"v": (-1, 1)}}
    with pytest.raises(ScenarioError, match=words):
        Robot(**{**given, **changes}, radius=0.1)


@pytest.mark.parametrize("make", [car_robot, unicycle_robot])
@pytest.mark.parametrize("field", ["radius", "speed", "reverse"])
def test_nonsense_is_refused(make, field):
    with pytest.raises(AnnDcError, match=field):
        make(**{field: -1.0})
