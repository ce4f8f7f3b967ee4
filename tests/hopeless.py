"""Problems that have no solution: targets that no controls reach, costs without a minimum."""

import sympy as sp

from ann_dc.problem.declaration import OptimalControlProblem

x, y, v, a, b, w = sp.symbols("x y v a b w")
still = sp.S.Zero


def plant(states, controls, rates, *, cost=None, horizon=10, dt=0.1, **ends):
    cost = sum(c**2 for c in controls) if cost is None else cost
    return OptimalControlProblem(
        states=states, controls=controls, dynamics=rates, cost=cost, horizon=horizon, dt=dt, **ends
    )


def turned(angle):
    """A point on a circle, turned by a control: its radius stays."""
    return OptimalControlProblem(
        states=(x, y),
        controls=(angle,),
        map=(x * sp.cos(angle) - y * sp.sin(angle), x * sp.sin(angle) + y * sp.cos(angle)),
        cost=angle**2,
        horizon=10,
        q_0=(1, 0),
        q_d=(2, 0),
    )


unicycle = (x, y, v), (a,)

INFEASIBLE = {
    "no control acts on it": (plant((x, v), (a,), (a, still), q_0=(0, 0), q_d=(1, 1)), {"v": 0}),
    "one stage for two": (
        plant((x, v), (a,), (v, a), horizon=1, q_0=(0, 0), q_d=(1, 0)),
        {"x": 0},
    ),
    "a control that saturates": (
        plant((x,), (a,), (sp.tanh(a),), q_0=(0,), q_d=(3,)),
        {"x": 1},
    ),
    "one way only": (plant((x,), (a,), (a**2,), q_0=(0,), q_d=(-1,)), {"x": 0}),
    "on a circle": (turned(w), {"x": 1}),
    "twins": (plant((x, y), (a,), (-x + a, -y + a), q_0=(0, 0), q_d=(1, -1)), {"x": 0, "y": 0}),
    "mass is kept": (
        plant((x, y), (a,), (-a * x, a * x), horizon=20, q_0=(1, 0), q_d=(0.5, 0.6)),
        {"y": 6 / 11, "x": 5 / 11},
    ),
    "always upwards": (plant((x,), (a,), (sp.exp(a),), q_0=(0,), q_d=(-1,)), {"x": 0}),
    "only decays": (plant((x,), (a,), (-x / (1 + a**2),), q_0=(1,), q_d=(2,)), {"x": 1}),
    "too far": (plant(*unicycle, (sp.cos(v), sp.sin(v), a), q_0=(0,) * 3, q_d=(5, 0, 0)), {"x": 1}),
    "too far, in other units": (
        plant(
            *unicycle,
            (1000 * sp.cos(v), 1000 * sp.sin(v), a),
            q_0=(0,) * 3,
            q_d=(5000, 0, 0),
            units={"x": "m"},
        ),
        {"x": 1000},
    ),
}
"""Problems, each with the components that are out of reach and where the nearest path ends."""

UNBOUNDED = {
    "a control is rewarded": plant((x,), (a,), (a,), cost=x**2 - a**2, dt=1.0, q_0=(0,)),
    "a linear cost": plant((x,), (a,), (a,), cost=a, dt=1.0, q_0=(0,)),
    "a state is rewarded": plant(
        (x, v), (a,), (v, a), cost=a**2 - 10 * x**2, horizon=20, dt=0.5, q_0=(0, 0)
    ),
    "between two ends": plant(
        (x, v), (a,), (v, a), cost=a**2 - 10 * x**2, horizon=40, dt=0.5, q_0=(0, 0), q_d=(1, 0)
    ),
    "a cubic": plant((x,), (a,), (a - x**3,), cost=a**3, q_0=(0,)),
    "a product": plant((x, y), (a, b), (a, b), cost=a * b, q_0=(0, 0)),
}
