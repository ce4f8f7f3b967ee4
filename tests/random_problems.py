"""Random problems of eight families: easy, hard, infeasible and unbounded ones among them."""

import numpy as np
import sympy as sp

from ann_dc.problem.declaration import OptimalControlProblem


def problem(family: str, seed: int) -> OptimalControlProblem:
    rng = np.random.default_rng(seed)
    states, controls, rates, cost, ends = FAMILIES[family](rng)
    return OptimalControlProblem(
        states=states,
        controls=controls,
        dynamics=rates,
        cost=cost,
        dt=float(10 ** rng.uniform(-2, -0.7)),
        horizon=int(rng.integers(3, 40)),
        name=f"{family} {seed}",
        **ends,
    )


def _symbols(n: int, m: int):
    return sp.symbols(f"x1:{n + 1}"), sp.symbols(f"a1:{m + 1}")


def _ends(rng, n: int, free: float = 0.2) -> dict:
    target = [None if rng.random() < free else float(v) for v in rng.normal(size=n)]
    return {"q_0": rng.normal(size=n).tolist(), "q_d": target}


def _effort(controls):
    return sum(a**2 for a in controls) / 2


def _linear(rng, shift: float):
    n, m = int(rng.integers(1, 5)), int(rng.integers(1, 3))
    x, a = _symbols(n, m)
    A, B = rng.normal(size=(n, n)) + shift * np.eye(n), rng.normal(size=(n, m))
    rates = [sum(A[i, j] * x[j] for j in range(n)) for i in range(n)]
    rates = [rate + sum(B[i, j] * a[j] for j in range(m)) for i, rate in enumerate(rates)]
    return x, a, rates, _effort(a) + rng.uniform(0, 1) * _effort(x), _ends(rng, n)


def stable(rng):
    return _linear(rng, -2.0)


def unstable(rng):
    return _linear(rng, 2.0)


def polynomial(rng):
    n = int(rng.integers(1, 4))
    x, a = _symbols(n, 1)
    rates = [x[(i + 1) % n] - rng.uniform(0, 1) * x[i] ** 3 for i in range(n)]
    rates[-1] += a[0] * (1 + rng.uniform(0, 1) * x[0])
    return x, a, rates, _effort(a) + _effort(x), _ends(rng, n)


def pendulum(rng):
    x, a = _symbols(2, 1)
    rates = [x[1], -9.81 * rng.uniform(0.3, 2) * sp.sin(x[0]) - 0.1 * x[1] + a[0]]
    return x, a, rates, _effort(a), {"q_0": (0, 0), "q_d": (float(rng.uniform(0, np.pi)), 0)}


def unicycle(rng):
    x, a = _symbols(3, 2)
    rates = [a[0] * sp.cos(x[2]), a[0] * sp.sin(x[2]), a[1]]
    return x, a, rates, _effort(a), {"q_0": (0, 0, 0), "q_d": (3 * rng.normal(size=3)).tolist()}


def saturated(rng):
    x, a = _symbols(2, 1)
    rates = [x[1], sp.tanh(a[0])]
    return x, a, rates, _effort(a), {"q_0": (0, 0), "q_d": (float(rng.uniform(0, 2)), 0)}


def uncontrolled(rng):
    x, a = _symbols(3, 1)
    rates = [x[1], a[0], -rng.uniform(0, 1) * x[2]]
    return x, a, rates, _effort(a), _ends(rng, 3)


def indefinite(rng):
    x, a = _symbols(2, 2)
    cost = _effort(a) + rng.normal() * x[0] * x[1] + rng.normal() * a[0] * a[1]
    return x, a, [a[0], a[1] + sp.sin(x[0])], cost, _ends(rng, 2, free=0.5)


FAMILIES = {
    maker.__name__: maker
    for maker in (
        stable, unstable, polynomial, pendulum, unicycle, saturated, uncontrolled, indefinite,
    )
}  # fmt: skip
