"""Vehicle plants: the paper's car, wheeled robots, a quadrotor, a spacecraft.

Each function declares one optimal-control problem in the manner of `ann_dc.problem.plants`, which
lists these plants.
"""

from __future__ import annotations

import sympy as sp

from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.validation import Finite, checked

HALF = sp.Rational(1, 2)


@checked
def car(
    *, D=1.0, c_over_m=1.0, gamma=0.1, dt=0.1, N=9, q_0=(0, 0, 0, 0), q_d=(5, 5, 0, 0)
) -> OptimalControlProblem:
    r"""Declare the paper's car: position (x, y), heading phi, steering angle varphi.

    .. math:: \dot q = \frac{c}{m} B(q) u - \gamma q

    Parameters
    ----------
    D : float
        Wheel base in metres.
    c_over_m : float
        Input gain c/m.
    gamma : float
        Damping in 1/s; (3) applies it to every state, so ``q_d`` is not an equilibrium unless gamma
        is 0.
    dt, N, q_0, q_d
        Sampling interval, horizon, initial state, terminal state.

    References
    ----------
    Paper equations (1), (3), (22), (23).

    Examples
    --------
    >>> print(car())
    car: 4 states (x, y, phi, varphi), 2 controls (nu, eta), 9 stages of 0.1 s
    """
    states = sp.symbols("x y phi varphi")
    _, _, phi, varphi = states
    nu, eta = sp.symbols("nu eta")
    B_u = (sp.cos(phi) * nu, sp.sin(phi) * nu, sp.tan(varphi) * nu / D, eta)
    return OptimalControlProblem(
        name="car", states=states, controls=(nu, eta),
        dynamics=[c_over_m * b - gamma * q for b, q in zip(B_u, states)],
        cost=HALF * (nu**2 + eta**2), dt=dt, horizon=N, q_0=q_0, q_d=q_d,
        units={
            "x": "m", "y": "m", "phi": "rad", "varphi": "rad", "nu": "m/s", "eta": "rad/s"
        },
    )  # fmt: skip


@checked
def unicycle(*, dt=0.1, N=20, q_0=(0, 0, 0), q_d=(2, 1, 0)) -> OptimalControlProblem:
    """Declare a wheeled robot that turns on the spot with minimum effort.

    The controls are the speed v and the turning rate omega.
    """
    v, omega = sp.symbols("v omega")
    return _unicycle("unicycle", HALF * (v**2 + omega**2), dt=dt, N=N, q_0=q_0, q_d=q_d)


@checked
def unicycle_soft_obstacle(
    *,
    effort=0.05,
    centre: tuple[Finite, Finite] = (1.5, 0.6),
    width=0.2,
    dt=0.1,
    N=40,
    q_0=(0, 0, 0),
    q_d=(3, 1, 0),
) -> OptimalControlProblem:
    """Declare a unicycle with a cost near a point, passed on the left or the right.

    The two passages are two optima.

    Parameters
    ----------
    effort : float
        Weight of v**2 + omega**2.
    centre : pair of floats
        Position of the obstacle in metres.
    width : float
        Width of the cost exp(-distance**2 / width), in square metres.
    """
    x, y, v, omega = sp.symbols("x y v omega")
    bump = sp.exp(-((x - centre[0]) ** 2 + (y - centre[1]) ** 2) / width)
    cost = effort * (v**2 + omega**2) + bump
    return _unicycle("unicycle_soft_obstacle", cost, dt=dt, N=N, q_0=q_0, q_d=q_d)


def _unicycle(name, cost, *, dt, N, q_0, q_d) -> OptimalControlProblem:
    x, y, theta = sp.symbols("x y theta")
    v, omega = sp.symbols("v omega")
    return OptimalControlProblem(
        name=name, states=(x, y, theta), controls=(v, omega),
        dynamics=(sp.cos(theta) * v, sp.sin(theta) * v, omega),
        cost=cost, dt=dt, horizon=N, q_0=q_0, q_d=q_d,
        units={"x": "m", "y": "m", "theta": "rad", "v": "m/s", "omega": "rad/s"},
    )  # fmt: skip


@checked
def bicycle(
    *, steering_weight=2.0, dt=0.1, N=30, q_0=(0, 0, 0, 1), q_d=(4, 1.5, 0, 1)
) -> OptimalControlProblem:
    """Declare a kinematic bicycle of unit wheel base.

    The states include heading psi and speed v; the controls are acceleration a, with cost a**2 / 2,
    and steering delta, with ``steering_weight`` times delta**2.
    """
    states = sp.symbols("x y psi v")
    _, _, psi, v = states
    a, delta = sp.symbols("a delta")
    return OptimalControlProblem(
        name="bicycle", states=states, controls=(a, delta),
        dynamics=(v * sp.cos(psi), v * sp.sin(psi), v * sp.tan(delta), a),
        cost=HALF * a**2 + steering_weight * delta**2, dt=dt, horizon=N, q_0=q_0, q_d=q_d,
        units={"x": "m", "y": "m", "psi": "rad", "v": "m/s", "a": "m/s^2", "delta": "rad"},
    )  # fmt: skip


@checked
def planar_quadrotor(
    *, g=9.81, effort=0.025, dt=0.05, N=30, q_0=(0,) * 6, q_d=(1, 1, 0, 0, 0, 0)
) -> OptimalControlProblem:
    """Declare a quadrotor in a vertical plane, from hover to hover.

    The controls are two thrusts divided by the mass. Gravity g is in m/s^2; each rotor hovers at g
    / 2. ``effort`` is the weight of the squared deviation of each thrust from hover.
    """
    states = sp.symbols("x y theta v_x v_y omega")
    _, _, theta, v_x, v_y, omega = states
    right, left = sp.symbols("thrust_right thrust_left")
    lift = right + left
    return OptimalControlProblem(
        name="planar_quadrotor", states=states, controls=(right, left),
        dynamics=(
            v_x, v_y, omega,
            -lift * sp.sin(theta), lift * sp.cos(theta) - g, 5 * (right - left),
        ),
        cost=effort * ((right - g / 2) ** 2 + (left - g / 2) ** 2),
        dt=dt, horizon=N, q_0=q_0, q_d=q_d,
        units={
            "x": "m", "y": "m", "theta": "rad", "v_x": "m/s", "v_y": "m/s", "omega": "rad/s",
            right: "m/s^2", left: "m/s^2",
        },
    )  # fmt: skip


@checked
def orbit_transfer(
    *, dt=0.06, N=100, q_0=(1, 0, 1), q_d=(1.5, 0, 1.5**-0.5)
) -> OptimalControlProblem:
    """Declare the raising of a circular orbit by radial and tangential thrust.

    Units make the gravitational parameter and the radius of the first orbit 1. The states are
    radius, radial speed and tangential speed.
    """
    r, v_r, v_t = states = sp.symbols("r v_r v_t")
    a_r, a_t = sp.symbols("a_r a_t")
    return OptimalControlProblem(
        name="orbit_transfer", states=states, controls=(a_r, a_t),
        dynamics=(v_r, v_t**2 / r - 1 / r**2 + a_r, -v_r * v_t / r + a_t),
        cost=HALF * (a_r**2 + a_t**2), dt=dt, horizon=N, q_0=q_0, q_d=q_d,
        units=dict.fromkeys((*states, a_r, a_t, "time"), "1"),
    )  # fmt: skip
