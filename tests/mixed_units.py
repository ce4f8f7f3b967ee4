"""Problems in mixed SI units: numbers from 1e-9 to 1e12 side by side."""

import sympy as sp

from ann_dc.problem.declaration import OptimalControlProblem


def _glider() -> OptimalControlProblem:
    """Metres, metres a second and radians: a path angle, held near level over a kilometre."""
    x, h, g, a = sp.symbols("x h gamma a")
    return OptimalControlProblem(
        name="glider", states=(x, h, g), controls=(a,),
        dynamics=(30 * sp.cos(g), 30 * sp.sin(g), a), cost=a**2, horizon=25, dt=1.5,
        q_0=(0, 1000, 0), q_d=(None, 900, 0),
    )  # fmt: skip


def _reactor() -> OptimalControlProblem:
    """Moles a cubic metre, kelvin and seconds."""
    c, T, q = sp.symbols("c T q")
    rate = 7.2e-4 * sp.exp(8750 * (1 / sp.Float(350) - 1 / T)) * c
    return OptimalControlProblem(
        name="batch reactor", states=(c, T), controls=(q,),
        dynamics=(-rate, 0.2 * rate + q), cost=q**2, horizon=20, dt=20.0,
        q_0=(1000, 340), q_d=(None, 355),
    )  # fmt: skip


def _satellite() -> OptimalControlProblem:
    """Kilometres and seconds: a rendezvous by Hill's equations in a low orbit."""
    x, y, v, w, a, b = sp.symbols("x y v w a b")
    n = 1.1e-3
    return OptimalControlProblem(
        name="satellite", states=(x, y, v, w), controls=(a, b),
        dynamics=(v, w, 3 * n**2 * x + 2 * n * w + a, -2 * n * v + b), cost=a**2 + b**2,
        horizon=30, dt=60.0, q_0=(1.0, -5.0, 0, 0), q_d=(0, 0, 0, 0),
    )  # fmt: skip


def _actuator() -> OptimalControlProblem:
    """Metres of nanometres, seconds of microseconds, volts."""
    z, v, u = sp.symbols("z v u")
    return OptimalControlProblem(
        name="actuator", states=(z, v), controls=(u,),
        dynamics=(v, -1e12 * z - 1e5 * v + 3e2 * u), cost=u**2, horizon=25, dt=2e-7,
        q_0=(0, 0), q_d=(2e-9, 0),
    )  # fmt: skip


def _economy() -> OptimalControlProblem:
    """Capital of 1e12, spent by 1e10 a year, with utility of a share."""
    K, c = sp.symbols("K c")
    return OptimalControlProblem(
        name="economy", states=(K,), controls=(c,),
        map=(1.03 * K - c,), cost=(c / 1e10 - 4) ** 2, horizon=20, q_0=(1e12,), q_d=(1.2e12,),
    )  # fmt: skip


MIXED = {make().name: make() for make in (_glider, _reactor, _satellite, _actuator, _economy)}
