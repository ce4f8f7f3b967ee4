"""Plants with free final time: the cost is time plus effort.

Each function declares one optimal-control problem in the manner of `ann_dc.problem.plants`, which
lists these plants.
"""

from __future__ import annotations

import math
from dataclasses import replace

import sympy as sp

from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.problem.step_length import StepLength, step_length
from ann_dc.problem.vehicles import HALF, car
from ann_dc.validation import checked


@checked
def car_free_time(
    *, time_weight=1.0, gamma=0.1, low=0.02, high=2.0, dt=None, N=9,
    q_0=(0, 0, 0, 0), q_d=(5, 5, 0, 0),
) -> OptimalControlProblem:  # fmt: skip
    r"""Declare the paper's car with free final time: minimum time plus effort.

    .. math:: \min \int_0^T w + \tfrac12 (\nu^2 + \eta^2)\, dt

    Parameters
    ----------
    time_weight : float
        Cost w of a second.
    gamma : float
        Damping in 1/s, as in the car.
    low, high : float
        Bounds of a free sampling interval in seconds.
    dt, N, q_0, q_d
        Sampling interval (free by default: optimised between its bounds), horizon, initial state,
        terminal state.

    Examples
    --------
    >>> problem = car_free_time()
    >>> problem.interval, problem.cost
    ('0.02 to 2 s', h*(eta**2/2 + nu**2/2 + 1.0))
    """
    given = car(gamma=gamma, N=N, q_0=q_0, q_d=q_d)
    return _timed(given, "car_free_time", time_weight, _step(dt, low, high))


@checked
def pendulum_free_time(
    *, time_weight=20.0, low=0.02, high=0.25, dt=None, N=20, q_0=(math.pi, 0), q_d=(0, 0)
) -> OptimalControlProblem:
    """Declare the pendulum swing-up with free final time: minimum time plus effort.

    With a high cost of time the pendulum swings up at once; with a low one it first swings back and
    forth.

    Parameters
    ----------
    time_weight : float
        Cost of a second, relative to an effort of half the squared torque.
    low, high : float
        Bounds of a free sampling interval in seconds.
    dt, N, q_0, q_d
        Sampling interval (free by default: optimised between its bounds), horizon, initial state,
        terminal state.
    """
    theta, omega, torque = sp.symbols("theta omega torque")
    given = OptimalControlProblem(
        name="pendulum", states=(theta, omega), controls=(torque,),
        dynamics=(omega, 4.905 * sp.sin(theta) - 0.1 * omega + torque),
        cost=HALF * torque**2, horizon=N, q_0=q_0, q_d=q_d,
        units={"theta": "rad", "omega": "rad/s", "torque": "rad/s^2"},
    )  # fmt: skip
    return _timed(given, "pendulum_free_time", time_weight, _step(dt, low, high))


def _step(dt, low, high) -> float | StepLength:
    return StepLength(low=low, high=high) if dt is None else step_length(dt)


def _timed(
    problem: OptimalControlProblem, name: str, weight: float, step: float | StepLength
) -> OptimalControlProblem:
    """Return the problem with its cost as a rate plus a cost of time."""
    h = step.symbol if isinstance(step, StepLength) else step
    return replace(problem, name=name, dt=step, cost=h * (weight + problem.cost))
