"""Example plants: each function declares one optimal-control problem.

The car is the paper's example. The others range from linear to chaotic systems; every backend must
solve all of them. Each declaration follows its textbook equation and is an example of a
declaration.

All functions take the horizon ``N``, the sampling interval ``dt`` (in seconds; dimensionless plants
use dimensionless time), the initial state ``q_0`` and the terminal state ``q_d`` (None frees a
component). Each plant declares its units of measure.

>>> print(get("unicycle")(N=10))
unicycle: 3 states (x, y, theta), 2 controls (v, omega), 10 stages of 0.1 s
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import sympy as sp

from ann_dc.errors import UnknownNameError
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.problem.step_length import StepLength, step_length as _step_length
from ann_dc.problem.vehicles import (
    HALF,
    bicycle,
    car,
    orbit_transfer,
    planar_quadrotor,
    unicycle,
    unicycle_soft_obstacle,
)
from ann_dc.validation import checked


@checked
def names() -> tuple[str, ...]:
    """Return the names of all plants, sorted.

    Returns
    -------
    tuple of str

    Examples
    --------
    >>> names()[:3]
    ('bicycle', 'car', 'car_free_time')
    """
    return tuple(sorted(_PLANTS))


@checked
def get(name: str) -> Callable[..., OptimalControlProblem]:
    """Return the function that declares the plant with this name.

    Parameters
    ----------
    name : str
        One of `names`.

    Returns
    -------
    callable
        Function of keyword-only arguments, all with defaults, that returns an
        `OptimalControlProblem`.

    Raises
    ------
    UnknownNameError If the name is unknown; the message lists the existing names.

    Examples
    --------
    >>> get("pendulum")(N=10).horizon
    10
    """
    try:
        return _PLANTS[name]
    except (KeyError, TypeError):
        raise UnknownNameError.of("plant", name, names()) from None


@checked
def double_integrator(*, dt=0.1, N=20, q_0=(0, 0), q_d=(1, 0)) -> OptimalControlProblem:
    """Declare minimum-effort motion of a mass on a rail (closed-form solution).

    The states are position x and speed v, the control is the acceleration a. In the discrete
    optimum, the acceleration decreases linearly in time.

    Examples
    --------
    >>> import ann_dc
    >>> ann_dc.solve(double_integrator(N=5))["a"][:2].round(3).tolist()
    [20.0, 10.0]
    """
    x, v, a = sp.symbols("x v a")
    return OptimalControlProblem(
        name="double_integrator", states=(x, v), controls=(a,),
        dynamics=(v, a), cost=HALF * a**2, dt=dt, horizon=N, q_0=q_0, q_d=q_d,
        units={"x": "m", "v": "m/s", "a": "m/s^2"},
    )  # fmt: skip


@checked
def lq(
    *, seed=1, spectral_radius=0.9, state_weight=1.0,
    dt=1.0, N=20, q_0=(1, -1, 0.5, 2), q_d=(0.5, 0, -0.5, 1),
) -> OptimalControlProblem:  # fmt: skip
    """Declare a random linear map q_{k+1} = A q + B u with quadratic cost.

    Parameters
    ----------
    seed : int
        Seed of the standard normal entries of A (4, 4), then of B (4, 2), which is halved.
    spectral_radius : float
        Spectral radius to which A is scaled; above 1 the plant is unstable.
    state_weight : float
        Weight c in the stage cost (c q'q + u'u) / 2.
    dt, N, q_0, q_d
        Label of the time axis, horizon, initial state, terminal state.
    """
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(4, 4))
    A *= spectral_radius / abs(np.linalg.eigvals(A)).max()
    B = 0.5 * rng.normal(size=(4, 2))
    states, controls = sp.symbols("x1:5"), sp.symbols("u1:3")
    q, u = np.array(states), np.array(controls)
    return OptimalControlProblem(
        name="lq", states=states, controls=controls,
        map=tuple(A @ q + B @ u), cost=HALF * (state_weight * (q @ q) + u @ u),
        dt=dt, horizon=N, q_0=q_0, q_d=q_d,
        units=dict.fromkeys((*states, *controls, "time"), "1"),
    )  # fmt: skip


@checked
def pendulum(*, effort=0.0375, dt=0.075, N=40, q_0=(np.pi, 0), q_d=(0, 0)) -> OptimalControlProblem:
    """Declare the minimum-effort swing-up of a hanging pendulum; theta = 0 is up.

    The torque is divided by the moment of inertia.

    Parameters
    ----------
    effort : float
        Weight of torque**2; the default dt / 2 makes the sum an integral over time.
    """
    torque = sp.Symbol("torque")
    return _pendulum("pendulum", effort * torque**2, dt=dt, N=N, q_0=q_0, q_d=q_d)


@checked
def pendulum_state_cost(
    *, rate_weight=0.2, height_weight=0.5, dt=0.075, N=40, q_0=(np.pi, 0), q_d=(0, 0)
) -> OptimalControlProblem:
    """Declare the pendulum swing-up with additional costs of speed and deviation.

    Parameters
    ----------
    rate_weight, height_weight : float
        Weights of omega**2 and of 1 - cos(theta) relative to torque**2; the sum is halved.
    """
    theta, omega, torque = sp.symbols("theta omega torque")
    cost = HALF * (torque**2 + rate_weight * omega**2 + height_weight * (1 - sp.cos(theta)))
    return _pendulum("pendulum_state_cost", cost, dt=dt, N=N, q_0=q_0, q_d=q_d)


def _pendulum(name, cost, *, dt, N, q_0, q_d) -> OptimalControlProblem:
    theta, omega, torque = sp.symbols("theta omega torque")
    return OptimalControlProblem(
        name=name, states=(theta, omega), controls=(torque,),
        dynamics=(omega, 4.905 * sp.sin(theta) - 0.1 * omega + torque),
        cost=cost, dt=dt, horizon=N, q_0=q_0, q_d=q_d,
        units={"theta": "rad", "omega": "rad/s", "torque": "rad/s^2"},
    )  # fmt: skip


@checked
def cart_pole(
    *, M=1.0, m=0.3, l=0.5, g=9.81, effort=0.002,  # noqa: E741
    dt=0.04, N=50, q_0=(0, 0, 0, 0), q_d=(0.5, np.pi, 0, 0),
) -> OptimalControlProblem:  # fmt: skip
    """Declare the swing-up of a pole that hangs from a driven cart; theta = 0 is down.

    Parameters
    ----------
    M, m : float
        Mass of the cart and of the pole's tip in kilograms.
    l, g : float
        Length of the pole in metres, gravity in m/s^2.
    effort : float
        Weight of force**2.
    """
    states = sp.symbols("x theta v omega")
    _, theta, v, omega = states
    force = sp.Symbol("force")
    s, c = sp.sin(theta), sp.cos(theta)
    inertia = M + m * s**2
    push = force + m * s * (l * omega**2 + g * c)
    turn = -force * c - m * l * omega**2 * c * s - (M + m) * g * s
    return OptimalControlProblem(
        name="cart_pole", states=states, controls=(force,),
        dynamics=(v, omega, push / inertia, turn / (l * inertia)),
        cost=effort * force**2, dt=dt, horizon=N, q_0=q_0, q_d=q_d,
        units={"x": "m", "theta": "rad", "v": "m/s", "omega": "rad/s", "force": "N"},
    )  # fmt: skip


@checked
def van_der_pol(*, weight=0.05, dt=0.1, N=40, q_0=(1, 0), q_d=(0, 0)) -> OptimalControlProblem:
    """Declare the stabilisation of a Van der Pol oscillator.

    Parameters
    ----------
    weight : float
        Factor of x**2 + v**2 + drive**2.
    """
    x, v, drive = sp.symbols("x v drive")
    return OptimalControlProblem(
        name="van_der_pol", states=(x, v), controls=(drive,),
        dynamics=(v, (1 - x**2) * v - x + drive),
        cost=weight * (x**2 + v**2 + drive**2), dt=dt, horizon=N, q_0=q_0, q_d=q_d,
        units=dict.fromkeys((x, v, drive, "time"), "1"),
    )  # fmt: skip


@checked
def two_link_arm(
    *, a1=0.5, a2=0.125, a3=0.125, friction=0.1, effort=0.02, rate_weight=0.002,
    dt=0.04, N=30, q_0=(0, 0.5, 0, 0), q_d=(1, 1.2, 0, 0),
) -> OptimalControlProblem:  # fmt: skip
    r"""Declare a two-link arm, :math:`M(q)\ddot q = u - h(q, \dot q) - d\,\dot q`.

    Parameters
    ----------
    a1, a2, a3 : float
        Inertias in kg m^2, with M = [[a1 + 2 a3 cos, a2 + a3 cos], [a2 + a3 cos, a2]] of the elbow
        angle. The arm is horizontal.
    friction : float
        Viscous friction d of both joints.
    effort, rate_weight : float
        Weights of the squared torques and of the squared joint rates.
    """
    states = sp.symbols("shoulder elbow rate_s rate_e")
    _, elbow, rate_s, rate_e = states
    torque_s, torque_e = sp.symbols("torque_s torque_e")
    s, c = sp.sin(elbow), sp.cos(elbow)
    m11, m12, m22 = a1 + 2 * a3 * c, a2 + a3 * c, a2
    r1 = torque_s + a3 * s * (2 * rate_s * rate_e + rate_e**2) - friction * rate_s
    r2 = torque_e - a3 * s * rate_s**2 - friction * rate_e
    determinant = m11 * m22 - m12**2
    return OptimalControlProblem(
        name="two_link_arm", states=states, controls=(torque_s, torque_e),
        dynamics=(
            rate_s, rate_e,
            (m22 * r1 - m12 * r2) / determinant, (m11 * r2 - m12 * r1) / determinant,
        ),
        cost=effort * (torque_s**2 + torque_e**2) + rate_weight * (rate_s**2 + rate_e**2),
        dt=dt, horizon=N, q_0=q_0, q_d=q_d,
        units={
            "shoulder": "rad", "elbow": "rad", "rate_s": "rad/s", "rate_e": "rad/s",
            "torque_s": "N*m", "torque_e": "N*m",
        },
    )  # fmt: skip


@checked
def cstr(*, dt=0.1, N=30, q_0=(0.9, 1.05), q_d=(0.55, 1.35)) -> OptimalControlProblem:
    """Declare a jacket-cooled stirred-tank reactor with an exothermic reaction.

    The reaction rate follows the Arrhenius law. Concentration, temperature, coolant temperature and
    time are dimensionless. The cost tracks the operating point (0.6, 1.3) with the coolant near 1.
    """
    concentration, temperature, coolant = sp.symbols("concentration temperature coolant")
    rate = 72 * sp.exp(-8 / temperature) * concentration
    return OptimalControlProblem(
        name="cstr", states=(concentration, temperature), controls=(coolant,),
        dynamics=(
            1 - concentration - 0.5 * rate,
            1 - temperature + 0.4 * rate - (temperature - coolant),
        ),
        cost=HALF * ((concentration - 0.6) ** 2 + (temperature - 1.3) ** 2)
        + 0.05 * (coolant - 1) ** 2,
        dt=dt, horizon=N, q_0=q_0, q_d=q_d,
        units=dict.fromkeys((concentration, temperature, coolant, "time"), "1"),
    )  # fmt: skip


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
    *, time_weight=20.0, low=0.02, high=0.25, dt=None, N=20, q_0=(np.pi, 0), q_d=(0, 0)
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
    given = _pendulum("pendulum", HALF * sp.Symbol("torque") ** 2, dt=1.0, N=N, q_0=q_0, q_d=q_d)
    return _timed(given, "pendulum_free_time", time_weight, _step(dt, low, high))


def _step(dt, low, high) -> float | StepLength:
    return StepLength(low=low, high=high) if dt is None else _step_length(dt)


def _timed(
    problem: OptimalControlProblem, name: str, weight: float, step: float | StepLength
) -> OptimalControlProblem:
    """Return the problem with its cost as a rate plus a cost of time."""
    h = step.symbol if isinstance(step, StepLength) else step
    return replace(problem, name=name, dt=step, cost=h * (weight + problem.cost))


_PLANTS = {
    plant.__name__: plant
    for plant in (
        car, unicycle, unicycle_soft_obstacle, bicycle, double_integrator, lq, pendulum,
        pendulum_state_cost, cart_pole, van_der_pol, planar_quadrotor, two_link_arm,
        orbit_transfer, cstr, car_free_time, pendulum_free_time,
    )
}  # fmt: skip
