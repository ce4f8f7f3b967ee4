"""Problems with inequalities: declared as they are told, with the optima that IPOPT finds."""

from __future__ import annotations

import numpy as np
import sympy as sp
from problems import SuiteProblem

from ann_dc import OptimalControlProblem

x, y, v, a, w, theta, phi = sp.symbols("x y v a w theta phi")


def integrator(*, N, dt, weight=1.0, q_0=(0, 0), q_d=(1, 0), **more) -> OptimalControlProblem:
    """A double integrator."""
    return OptimalControlProblem(
        states=(x, v), controls=(a,), dynamics=(v, a), dt=dt, horizon=N,
        cost=weight * a**2 / 2, q_0=q_0, q_d=q_d, **more,
    )  # fmt: skip


def dint_u():
    """Limited acceleration."""
    return integrator(N=22, dt=0.1, bounds={a: (-1, 1)}, name="dint_u")


def dint_v():
    """Limited speed."""
    return integrator(N=30, dt=0.1, bounds={v: (None, 0.4)}, name="dint_v")


def bryson():
    """Bryson and Denham: a wall at 1/9."""
    return integrator(
        N=40, dt=0.025, weight=0.025, q_0=(0, 1), q_d=(0, -1), bounds={x: (None, 1 / 9)},
        name="bryson",
    )  # fmt: skip


def corridor():
    """A corridor that swings from side to side."""
    r = sp.Symbol("r")
    return integrator(
        N=40, dt=0.1, weight=0.1, q_d=(0, 0), name="corridor",
        inputs={r: 0.4 * np.sin(2 * np.pi * np.arange(40) / 40)},
        constraints={"right": x <= r + 0.1, "left": x >= r - 0.1},
    )  # fmt: skip


def car(*, N, **more) -> OptimalControlProblem:
    """The paper's car, from the origin to (5, 5)."""
    nu, eta = sp.symbols("nu eta")
    turn = sp.tan(phi)
    return OptimalControlProblem(
        states=(x, y, theta, phi), controls=(nu, eta), dt=0.1, horizon=N,
        dynamics=(
            -0.1 * x + sp.cos(theta) * nu, -0.1 * y + sp.sin(theta) * nu,
            -0.1 * theta + turn * nu, -0.1 * phi + eta,
        ),
        cost=(nu**2 + eta**2) / 2, q_0=(0, 0, 0, 0), q_d=(5, 5, 0, 0), **more,
    )  # fmt: skip


def outside(cx, cy, radius):
    """Of a disc, as a distance."""
    return ((x - cx) ** 2 + (y - cy) ** 2) / (2 * radius) >= radius / 2


def car_steer():
    """Limited speed, steering rate and steering angle."""
    return car(N=20, bounds={"nu": (0, 4.5), "eta": (-2, 2), phi: (-0.5, 0.5)}, name="car_steer")


def car_discs(name, *discs):
    """Among discs."""
    return car(N=24, constraints=[outside(*disc) for disc in discs], name=name)


def unicycle(*, q_d, **more) -> OptimalControlProblem:
    """A unicycle along the x axis."""
    nu, turn = sp.symbols("nu turn")
    return OptimalControlProblem(
        states=(x, y, theta), controls=(nu, turn), dt=0.1, horizon=30,
        dynamics=(sp.cos(theta) * nu, sp.sin(theta) * nu, turn),
        cost=(nu**2 + turn**2) / 2, q_0=(0, 0, 0), q_d=q_d, **more,
    )  # fmt: skip


def uni_gap():
    """A gap of 0.3 beside the straight line."""
    discs = [outside(1.5, 1.15, 0.6), outside(1.5, -0.55, 0.8)]
    return unicycle(q_d=(3, 0, 0), constraints=discs, name="uni_gap")


def uni_poly():
    """A rectangle, its corners rounded by a smooth maximum."""
    faces = (x - 2, 1 - x, y - 0.6, -0.3 - y)
    rounded = 0.05 * sp.log(sum(sp.exp(face / 0.05) for face in faces))
    return unicycle(q_d=(3, 0, 0), constraints=[rounded >= 0], name="uni_poly")


def moving():
    """Two discs that cross the way."""
    down, up = sp.symbols("down up")
    t = 0.1 * np.arange(30)
    return unicycle(
        q_d=(3, 0.3, 0), inputs={down: 1.2 - 0.9 * t, up: -1.6 + 0.9 * t}, name="moving",
        bounds={"nu": (0, 2), "turn": (-2.5, 2.5)},
        constraints=[outside(1.2, down, 0.4), outside(2.3, up, 0.4)],
    )  # fmt: skip


def pendulum(limit, name):
    """Swung up with little torque."""
    return OptimalControlProblem(
        states=(theta, w), controls=(a,), dt=0.075, horizon=60, q_0=(np.pi, 0), q_d=(0, 0),
        dynamics=(w, 4.905 * sp.sin(theta) - 0.1 * w + a), cost=0.0375 * a**2,
        bounds={a: (-limit, limit)}, name=name,
    )  # fmt: skip


def vdp_u():
    """Van der Pol's oscillator, hardly any control free."""
    return OptimalControlProblem(
        states=(x, v), controls=(a,), dt=0.1, horizon=40, q_0=(1, 0), q_d=(0, 0),
        dynamics=(v, (1 - x**2) * v - x + a), cost=0.05 * (x**2 + v**2 + a**2),
        bounds={a: (-0.4, 0.75)}, name="vdp_u",
    )  # fmt: skip


def quad_T():
    """A planar quadrotor with limited thrust."""
    vx, vy, left, right = sp.symbols("vx vy left right")
    thrust = left + right
    return OptimalControlProblem(
        states=(x, y, theta, vx, vy, w), controls=(left, right), dt=0.05, horizon=30,
        dynamics=(
            vx, vy, w, -thrust * sp.sin(theta), thrust * sp.cos(theta) - 9.81, 5 * (left - right)
        ),
        cost=0.025 * ((left - 4.905) ** 2 + (right - 4.905) ** 2),
        q_0=(0,) * 6, q_d=(1, 1, 0, 0, 0, 0), name="quad_T",
        bounds={left: (0, 6.5), right: (0, 6.5)},
    )  # fmt: skip


def cstr_T():
    """A stirred tank whose temperature is limited."""
    rate = 72 * sp.exp(-8 / y)
    return OptimalControlProblem(
        states=(x, y), controls=(a,), dt=0.1, horizon=30, q_0=(0.9, 1.05), q_d=(0.55, 1.35),
        dynamics=(1 - x - 0.5 * rate * x, 1 - y + 0.4 * rate * x - (y - a)),
        cost=0.5 * ((x - 0.6) ** 2 + (y - 1.3) ** 2) + 0.05 * (a - 1) ** 2,
        bounds={y: (None, 2.5), a: (0, 6)}, name="cstr_T",
    )  # fmt: skip


def goddard():
    """Goddard's rocket, with a small effort: a singular arc."""
    mass, u = sp.symbols("mass u")
    pressure = 3.1 * w**2 * sp.exp(-5 * y)
    return OptimalControlProblem(
        states=(y, w, mass), controls=(u,), dt=0.05, horizon=40,
        q_0=(0, 0, 1), q_d=(None, None, 0.6), name="goddard",
        dynamics=(w, (u - pressure) / mass - 1 / (1 + 0.01 * y) ** 2, -0.2 * u),
        cost=-0.05 * w + 0.00125 * u**2, constraints={"pressure": pressure <= 0.5},
        bounds={u: (0, 3.5), y: (-0.1, 1.6), w: (-0.2, 1.5), mass: (0.5, 1.1)},
    )  # fmt: skip


def arm_u():
    """A two-link arm with limited torques."""
    first, second, w1, w2, t1, t2 = sp.symbols("first second w1 w2 t1 t2")
    c, s = sp.cos(second), sp.sin(second)
    m11, m12, m22 = 0.5 + 0.25 * c, 0.125 + 0.125 * c, 0.125
    r1 = t1 + 0.125 * s * (2 * w1 * w2 + w2**2) - 0.1 * w1
    r2 = t2 - 0.125 * s * w1**2 - 0.1 * w2
    det = m11 * m22 - m12**2
    return OptimalControlProblem(
        states=(first, second, w1, w2), controls=(t1, t2), dt=0.04, horizon=30,
        dynamics=(w1, w2, (m22 * r1 - m12 * r2) / det, (m11 * r2 - m12 * r1) / det),
        cost=0.02 * (t1**2 + t2**2) + 0.002 * (w1**2 + w2**2),
        q_0=(0, 0.5, 0, 0), q_d=(1, 1.2, 0, 0), bounds={t1: (-3, 3), t2: (-1, 1)}, name="arm_u",
    )  # fmt: skip


def lander():
    """A lander within its glide slope."""
    vx, vy, right, up = sp.symbols("vx vy right up")
    return OptimalControlProblem(
        states=(x, y, vx, vy), controls=(right, up), dt=0.1, horizon=50,
        dynamics=(vx, vy, right, up - 1), cost=0.05 * (right**2 + up**2),
        q_0=(1.5, 3, -0.9, -0.6), q_d=(0, 0, 0, 0), bounds={up: (0.2, None)}, name="lander",
        constraints={
            "thrust": right**2 + up**2 <= 1.96,
            "slope_right": x <= 0.45 * y + 0.15,
            "slope_left": -x <= 0.45 * y + 0.15,
        },
    )  # fmt: skip


def cartpole_u():
    """A cart and pole on a short track."""
    force, s, c = sp.Symbol("force"), sp.sin(theta), sp.cos(theta)
    moved = (force + 0.3 * s * (0.5 * w**2 + 9.81 * c)) / (1 + 0.3 * s**2)
    turned = -(force * c + 0.15 * w**2 * c * s + 1.3 * 9.81 * s) / (0.5 * (1 + 0.3 * s**2))
    return OptimalControlProblem(
        states=(x, theta, v, w), controls=(force,), dt=0.04, horizon=50,
        dynamics=(v, w, moved, turned), cost=0.002 * force**2,
        q_0=(0, 0, 0, 0), q_d=(0.5, np.pi, 0, 0), name="cartpole_u",
        bounds={force: (-12, 12), x: (-0.4, 0.6)},
    )  # fmt: skip


def tank_level():
    """Two tanks in a row, the level of the first one limited, the end free."""
    first, second, pump = sp.symbols("first second pump")
    return OptimalControlProblem(
        states=(first, second), controls=(pump,), dt=0.2, horizon=25, name="tank_level",
        dynamics=(pump - sp.sqrt(first), sp.sqrt(first) - sp.sqrt(second)),
        cost=(second - 1.5) ** 2 + 0.1 * (pump - 1) ** 2, q_0=(1, 1), q_d=(None, None),
        bounds={first: (0.5, 2.2), pump: (0, 2.5)},
    )  # fmt: skip


def two_tanks() -> OptimalControlProblem:
    """Water from one into the other by a limited pump; time constants alone do not settle."""
    upper, lower, pump = sp.symbols("upper lower pump")
    return OptimalControlProblem(
        states=(upper, lower), controls=(pump,), dt=0.5, horizon=3, name="two_tanks",
        dynamics=(
            pump - 0.4 * sp.sqrt(upper), 0.4 * sp.sqrt(upper) - 0.3 * sp.sqrt(lower),
        ),
        cost=0.1 * pump**2 + (lower - 0.6) ** 2, q_0=(0.5, 0.3), q_d=(1, None),
        bounds={pump: (0, 0.8)},
    )  # fmt: skip


def cart() -> OptimalControlProblem:
    """It is to be far away, and may hardly move: its control is pressed hard against its bound."""
    return OptimalControlProblem(
        states=(x,), controls=(v,), dynamics=(v,), dt=0.2, horizon=5, name="cart",
        cost=10 * (x - 1) ** 2 + v**2, q_0=(0,), q_d=(None,), bounds={v: (-0.5, 0.5)},
    )  # fmt: skip


def bioreactor() -> OptimalControlProblem:
    """Cells that grow on what is fed; the feed ends at its limit."""
    cells, food, feed = sp.symbols("cells food feed")
    grown = cells * food / (1 + food)
    return OptimalControlProblem(
        states=(cells, food), controls=(feed,), dt=0.25, horizon=8, name="bioreactor",
        dynamics=(grown - feed * cells, feed * (2 - food) - grown), cost=feed**2,
        q_0=(0.8, 0.5), q_d=(1, None), bounds={feed: (0, 0.3)},
    )  # fmt: skip


def past_disc():
    """A point that walks around a disc, which most of its stages do not touch."""
    right, up = sp.symbols("right up")
    return OptimalControlProblem(
        states=(x, y), controls=(right, up), dynamics=(right, up), dt=0.1, horizon=6,
        cost=(right**2 + up**2) / 2, q_0=(0, 0), q_d=(2, 0), name="past_disc",
        constraints={"disc": (x - 1) ** 2 + (y + 0.2) ** 2 >= 0.25},
    )  # fmt: skip


def end_disc():
    """A cart that has to end within a disc of position and speed."""
    return integrator(
        N=20, dt=0.1, q_d=(None, None), name="end_disc",
        terminal_constraints={"near": (x - 1) ** 2 + v**2 <= 0.04},
    )  # fmt: skip


def power():
    """A motor whose power is limited: a row of state times control."""
    return integrator(
        N=25, dt=0.1, q_0=(0, 0.2), constraints={"power": v * a <= 0.12}, name="power"
    )


def free_start():
    """A free start between walls: far enough back to brake in time."""
    return integrator(
        N=20, dt=0.1, q_0=(None, 1), q_d=(1, 0), bounds={x: (0.7, 1.1)}, name="free_start"
    )


def dose():
    """A dose with two compartments, the second one limited."""
    blood, tissue, rate = sp.symbols("blood tissue rate")
    return OptimalControlProblem(
        states=(blood, tissue), controls=(rate,), dt=0.25, horizon=24, name="dose",
        dynamics=(rate - 0.8 * blood + 0.2 * tissue, 0.5 * blood - 0.3 * tissue),
        cost=(blood - 1) ** 2 + 0.05 * rate**2, q_0=(0, 0), q_d=(None, 1),
        bounds={rate: (0, 1.5), tissue: (None, 1.3)},
    )  # fmt: skip


def crane():
    """A crane whose load swings no further than allowed."""
    return OptimalControlProblem(
        states=(x, v, theta, w), controls=(a,), dt=0.1, horizon=60, name="crane",
        dynamics=(v, a, w, -sp.sin(theta) - a * sp.cos(theta) - 0.2 * w), cost=a**2 / 2,
        q_0=(0, 0, 0, 0), q_d=(2, 0, 0, 0), bounds={theta: (-0.3, 0.3), v: (None, 0.5)},
    )  # fmt: skip


CONSTRAINED = {
    "dint_u": SuiteProblem(dint_u, (5.71912,)),
    "dint_v": SuiteProblem(dint_v, (2.85714,)),
    "bryson": SuiteProblem(bryson, (4.05744,)),
    "corridor": SuiteProblem(corridor, (1.68079,)),
    "car_steer": SuiteProblem(car_steer, (200.181,)),
    "car_disc1": SuiteProblem(lambda: car_discs("car_disc1", (2.6, 2, 0.8)), (177.357, 177.879)),
    "car_disc3": SuiteProblem(
        lambda: car_discs("car_disc3", (1.6, 0.9, 0.5), (2.9, 3, 0.6), (4.2, 3.6, 0.4)),
        (172.425, 187.0, 219.51, 253.625, 269.105),
    ),
    "car_disc4": SuiteProblem(
        lambda: car_discs(
            "car_disc4", (1.2, 0.3, 0.45), (2, 2.1, 0.5), (3.4, 2.6, 0.5), (4.1, 4.4, 0.45)
        ),
        (183.519, 184.844, 190.341, 193.17, 202.676, 234.365, 237.241),
    ),
    "uni_gap": SuiteProblem(uni_gap, (17.617,)),
    "uni_poly": SuiteProblem(uni_poly, (19.7545, 19.7808, 19.78751, 19.8252, 201.699)),
    "moving": SuiteProblem(moving, (18.0196, 19.2799)),
    "pend_u": SuiteProblem(lambda: pendulum(2.5, "pend_u"), (4.816405, 5.25788)),
    "pend_u2": SuiteProblem(lambda: pendulum(2.0, "pend_u2"), (4.84456, 5.90558)),
    "vdp_u": SuiteProblem(vdp_u, (2.03317,)),
    "quad_T": SuiteProblem(quad_T, (1.56962,)),
    "cstr_T": SuiteProblem(cstr_T, (12.1459,)),
    "arm_u": SuiteProblem(arm_u, (2.17285,)),
    "lander": SuiteProblem(lander, (3.35177,)),
    "goddard": SuiteProblem(goddard, (-1.04585,)),
    "cartpole_u": SuiteProblem(cartpole_u, (1.81322, 3.09138)),
    "tank_level": SuiteProblem(tank_level, ()),
    "end_disc": SuiteProblem(end_disc, ()),
    "power": SuiteProblem(power, ()),
    "free_start": SuiteProblem(free_start, ()),
    "dose": SuiteProblem(dose, ()),
    "crane": SuiteProblem(crane, ()),
}
"""Those of `equations` with their optima; and six more, each with a kind of row that they lack."""
