r"""Plants to control: each function declares one optimal-control problem.

The car is the paper's example; the others range from linear to chaotic and are the suite that
every backend must solve. Each declaration reads like its textbook equation and doubles as an
example of how to declare a problem. All take the horizon ``N``, the sampling interval ``dt`` in
seconds, the start ``q_0`` and the target ``q_d`` (None frees a component).

>>> print(get("unicycle")(N=10))
unicycle: 3 states (x, y, theta), 2 controls (v, omega), 10 stages of 0.1
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import sympy as sp

from ann_dc.errors import UnknownNameError
from ann_dc.problem.declaration import OptimalControlProblem

HALF = sp.Rational(1, 2)


def names() -> tuple[str, ...]:
    """The names of all plants, sorted."""
    return tuple(sorted(_PLANTS))


def get(name: str) -> Callable[..., OptimalControlProblem]:
    """The function that declares the plant of this name.

    Raises
    ------
    UnknownNameError
        Listing the names that exist.
    """
    try:
        return _PLANTS[name]
    except (KeyError, TypeError):
        raise UnknownNameError.of("plant", name, names()) from None


def car(
    *, D=1.0, c_over_m=1.0, gamma=0.1, dt=0.1, N=9, q_0=(0, 0, 0, 0), q_d=(5, 5, 0, 0)
) -> OptimalControlProblem:
    r"""The paper's car: position (x, y), heading phi, steering angle varphi.

    .. math:: \dot q = \frac{c}{m} B(q) u - \gamma q

    Parameters
    ----------
    D : float
        Wheel base in metres.
    c_over_m : float
        Input gain c/m.
    gamma : float
        Damping in 1/s; (3) applies it to every state, so ``q_d`` is no rest point unless it is 0.
    dt, N, q_0, q_d
        Sampling interval, horizon, start, target.

    References
    ----------
    Paper equations (1), (3), (22), (23).
    """
    states = sp.symbols("x y phi varphi")
    _, _, phi, varphi = states
    nu, eta = sp.symbols("nu eta")
    B_u = (sp.cos(phi) * nu, sp.sin(phi) * nu, sp.tan(varphi) * nu / D, eta)
    return OptimalControlProblem(
        name="car", states=states, controls=(nu, eta),
        dynamics=[c_over_m * b - gamma * q for b, q in zip(B_u, states)],
        cost=HALF * (nu**2 + eta**2), dt=dt, horizon=N, q_0=q_0, q_d=q_d,
    )  # fmt: skip


def unicycle(*, dt=0.1, N=20, q_0=(0, 0, 0), q_d=(2, 1, 0)) -> OptimalControlProblem:
    """A wheeled robot that turns on the spot: speed v and turning rate omega, least effort."""
    v, omega = sp.symbols("v omega")
    return _unicycle("unicycle", HALF * (v**2 + omega**2), dt=dt, N=N, q_0=q_0, q_d=q_d)


def unicycle_soft_obstacle(
    *, effort=0.05, centre=(1.5, 0.6), width=0.2, dt=0.1, N=40, q_0=(0, 0, 0), q_d=(3, 1, 0)
) -> OptimalControlProblem:
    """A unicycle that pays for coming near a point: passing left and right are two optima.

    Parameters
    ----------
    effort : float
        Weight of v**2 + omega**2.
    centre : pair of floats
        Position of the obstacle in metres.
    width : float
        The bump is exp(-distance**2 / width), in square metres.
    dt, N, q_0, q_d
        Sampling interval, horizon, start, target.
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
    )  # fmt: skip


def bicycle(
    *, steering_weight=2.0, dt=0.1, N=30, q_0=(0, 0, 0, 1), q_d=(4, 1.5, 0, 1)
) -> OptimalControlProblem:
    """A kinematic bicycle of unit wheel base: heading psi, speed v, acceleration a, steering delta.

    Parameters
    ----------
    steering_weight : float
        Weight of delta**2 in the stage cost; the acceleration costs a**2 / 2.
    dt, N, q_0, q_d
        Sampling interval, horizon, start, target.
    """
    states = sp.symbols("x y psi v")
    _, _, psi, v = states
    a, delta = sp.symbols("a delta")
    return OptimalControlProblem(
        name="bicycle", states=states, controls=(a, delta),
        dynamics=(v * sp.cos(psi), v * sp.sin(psi), v * sp.tan(delta), a),
        cost=HALF * a**2 + steering_weight * delta**2, dt=dt, horizon=N, q_0=q_0, q_d=q_d,
    )  # fmt: skip


def double_integrator(*, dt=0.1, N=20, q_0=(0, 0), q_d=(1, 0)) -> OptimalControlProblem:
    """A mass on a rail: position x, speed v, acceleration a, least effort. Has a closed form."""
    x, v, a = sp.symbols("x v a")
    return OptimalControlProblem(
        name="double_integrator", states=(x, v), controls=(a,),
        dynamics=(v, a), cost=HALF * a**2, dt=dt, horizon=N, q_0=q_0, q_d=q_d,
    )  # fmt: skip


def lq(
    *, seed=1, spectral_radius=0.9, state_weight=1.0,
    dt=1.0, N=20, q_0=(1, -1, 0.5, 2), q_d=(0.5, 0, -0.5, 1),
) -> OptimalControlProblem:  # fmt: skip
    """A random linear map q_{k+1} = A q + B u with quadratic cost.

    Parameters
    ----------
    seed : int
        Seed of the standard normal entries of A (4, 4), then of B (4, 2), which is halved.
    spectral_radius : float
        What A is scaled to; above 1 the plant is unstable.
    state_weight : float
        c in the stage cost (c q'q + u'u) / 2.
    dt, N, q_0, q_d
        Label of the time axis, horizon, start, target.
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
    )  # fmt: skip


def pendulum(*, effort=0.0375, dt=0.075, N=40, q_0=(np.pi, 0), q_d=(0, 0)) -> OptimalControlProblem:
    """Swing a hanging pendulum upright with least effort; theta = 0 is up.

    Parameters
    ----------
    effort : float
        Weight of torque**2; the default dt / 2 makes the sum an integral over time.
    dt, N, q_0, q_d
        Sampling interval, horizon, start, target.
    """
    torque = sp.Symbol("torque")
    return _pendulum("pendulum", effort * torque**2, dt=dt, N=N, q_0=q_0, q_d=q_d)


def pendulum_state_cost(
    *, rate_weight=0.2, height_weight=0.5, dt=0.075, N=40, q_0=(np.pi, 0), q_d=(0, 0)
) -> OptimalControlProblem:
    """The same swing-up that also pays for speed and for not being upright.

    Parameters
    ----------
    rate_weight, height_weight : float
        Weights of omega**2 and of 1 - cos(theta) beside torque**2; the sum is halved.
    dt, N, q_0, q_d
        Sampling interval, horizon, start, target.
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
    )  # fmt: skip


def cart_pole(
    *, M=1.0, m=0.3, l=0.5, g=9.81, effort=0.002,  # noqa: E741
    dt=0.04, N=50, q_0=(0, 0, 0, 0), q_d=(0.5, np.pi, 0, 0),
) -> OptimalControlProblem:  # fmt: skip
    """Swing up a pole by pushing the cart it hangs from; theta = 0 is down.

    Parameters
    ----------
    M, m : float
        Mass of the cart and of the pole's tip in kilograms.
    l, g : float
        Length of the pole in metres, gravity in m/s^2.
    effort : float
        Weight of force**2.
    dt, N, q_0, q_d
        Sampling interval, horizon, start, target.
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
    )  # fmt: skip


def van_der_pol(*, weight=0.05, dt=0.1, N=40, q_0=(1, 0), q_d=(0, 0)) -> OptimalControlProblem:
    """Bring the Van der Pol oscillator to rest; ``weight`` multiplies x**2 + v**2 + drive**2."""
    x, v, drive = sp.symbols("x v drive")
    return OptimalControlProblem(
        name="van_der_pol", states=(x, v), controls=(drive,),
        dynamics=(v, (1 - x**2) * v - x + drive),
        cost=weight * (x**2 + v**2 + drive**2), dt=dt, horizon=N, q_0=q_0, q_d=q_d,
    )  # fmt: skip


def planar_quadrotor(
    *, g=9.81, effort=0.025, dt=0.05, N=30, q_0=(0,) * 6, q_d=(1, 1, 0, 0, 0, 0)
) -> OptimalControlProblem:
    """A quadrotor in a vertical plane, from hover to hover; two thrusts in units of mass.

    Parameters
    ----------
    g : float
        Gravity in m/s^2; each rotor hovers at g / 2.
    effort : float
        Weight of the squared deviation of each thrust from hover.
    dt, N, q_0, q_d
        Sampling interval, horizon, start, target.
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
    )  # fmt: skip


def two_link_arm(
    *, a1=0.5, a2=0.125, a3=0.125, friction=0.1, effort=0.02, rate_weight=0.002,
    dt=0.04, N=30, q_0=(0, 0.5, 0, 0), q_d=(1, 1.2, 0, 0),
) -> OptimalControlProblem:  # fmt: skip
    r"""A horizontal two-link arm, :math:`M(q)\ddot q = u - h(q, \dot q) - d\,\dot q`.

    Parameters
    ----------
    a1, a2, a3 : float
        Inertias: M = [[a1 + 2 a3 cos, a2 + a3 cos], [a2 + a3 cos, a2]] of the elbow angle.
    friction : float
        Viscous friction d of both joints.
    effort, rate_weight : float
        Weights of the squared torques and of the squared joint rates.
    dt, N, q_0, q_d
        Sampling interval, horizon, start, target.
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
    )  # fmt: skip


def orbit_transfer(
    *, dt=0.06, N=100, q_0=(1, 0, 1), q_d=(1.5, 0, 1.5**-0.5)
) -> OptimalControlProblem:
    """Raise a circular orbit with thrust in the radial and the tangential direction.

    Units make the gravitational parameter and the radius of the first orbit 1.
    """
    r, v_r, v_t = states = sp.symbols("r v_r v_t")
    a_r, a_t = sp.symbols("a_r a_t")
    return OptimalControlProblem(
        name="orbit_transfer", states=states, controls=(a_r, a_t),
        dynamics=(v_r, v_t**2 / r - 1 / r**2 + a_r, -v_r * v_t / r + a_t),
        cost=HALF * (a_r**2 + a_t**2), dt=dt, horizon=N, q_0=q_0, q_d=q_d,
    )  # fmt: skip


def cstr(*, dt=0.1, N=30, q_0=(0.9, 1.05), q_d=(0.55, 1.35)) -> OptimalControlProblem:
    """A stirred-tank reactor with an exothermic Arrhenius reaction, cooled by its jacket.

    Concentration, temperature and coolant temperature are dimensionless; the cost tracks the
    operating point (0.6, 1.3) with the coolant near 1.
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
    )  # fmt: skip


_PLANTS = {
    plant.__name__: plant
    for plant in (
        car, unicycle, unicycle_soft_obstacle, bicycle, double_integrator, lq, pendulum,
        pendulum_state_cost, cart_pole, van_der_pol, planar_quadrotor, two_link_arm,
        orbit_transfer, cstr,
    )
}  # fmt: skip
