"""Problems with several objectives, and IPOPT on their epigraph form: s minimal, J_i <= s."""

from __future__ import annotations

from dataclasses import dataclass, replace

import casadi as ca
import numpy as np
import sympy as sp
from reference import _OPTIONS, _bounds, _inputs, _pack, _translator

from ann_dc import OptimalControlProblem, interpolated_guess

x, y, theta, phi, nu, eta, late = sp.symbols("x y theta phi nu eta late")
N, DT = 12, 0.1
PLANT = (
    -0.1 * x + sp.cos(theta) * nu,
    -0.1 * y + sp.sin(theta) * nu,
    -0.1 * theta + sp.tan(phi) * nu,
    -0.1 * phi + eta,
)
EFFORT = (nu**2 + eta**2) / 2
OBJECTIVES = {
    "effort": EFFORT,
    "length": N * DT**2 * (PLANT[0] ** 2 + PLANT[1] ** 2) + 0.02 * EFFORT,
    "late": late * EFFORT,
}
IDEAL = {"effort": 107.6039, "length": 17.0717, "late": 91.5126}
NADIR = {"effort": 159.7320, "length": 24.8483, "late": 148.6186}


def by_range(name: str) -> sp.Expr:
    """0 at the ideal point, 1 at the nadir."""
    return (OBJECTIVES[name] - IDEAL[name] / N) / (NADIR[name] - IDEAL[name])


def car(objectives, **more) -> OptimalControlProblem:
    """The paper's car with some objectives."""
    return OptimalControlProblem(
        states=(x, y, theta, phi), controls=(nu, eta), dynamics=PLANT, dt=DT, horizon=N,
        q_0=(0, 0, 0, 0), q_d=(3, 2, 0, 0), inputs={late: 2 * (np.arange(N) + 1) / N},
        objectives=objectives, name="minimax", **more,
    )  # fmt: skip


CASES = {
    "two by range": ({n: by_range(n) for n in ("effort", "length")}, 0.047428),
    "three by range": ({n: by_range(n) for n in OBJECTIVES}, 0.212883),
    "three by ideal": ({n: OBJECTIVES[n] / IDEAL[n] for n in OBJECTIVES}, 1.11543),
}
"""Objectives, and the least that the largest can be."""


def small(stages: int = 5, **more) -> OptimalControlProblem:
    """A cart: effort against lateness."""
    v, a = sp.symbols("v a")
    return OptimalControlProblem(
        states=(x, v), controls=(a,), dynamics=(v, a), dt=0.1, horizon=stages,
        q_0=(0, 0), q_d=(1, 0), name="cart",
        objectives={"effort": a**2 / 800, "error": (x - 1) ** 2 + a**2 / 8000}, **more,
    )  # fmt: skip


@dataclass(frozen=True)
class Epigraph:
    """What IPOPT found: the cost with the largest objective, and every objective's share."""

    objective: float
    shares: np.ndarray
    values: np.ndarray
    point: np.ndarray


def epigraph(problem: OptimalControlProblem) -> Epigraph:
    """The largest w_i J_i made small, with the common cost, from the straight line.

    At a temperature T, T log sum_i exp((w_i J_i - s) / T) is none above zero, and the start is
    where the largest itself is smallest.
    """
    n, m, stages = problem.n, problem.m, problem.horizon
    q, u, s = ca.SX.sym("q", n, stages + 1), ca.SX.sym("u", m, stages), ca.SX.sym("s")
    of_q, of_u, of_inputs, translate = _translator(problem)
    parts = [*problem.f, problem.cost, *problem.stage_objectives.values()]
    stage = ca.Function("stage", [of_q, of_u, of_inputs], [translate(parts)])
    inputs = _inputs(problem)
    reported = [stage(q[:, k], u[:, k], inputs[:, k]) for k in range(stages)]
    gaps = ca.vertcat(*(own[:n] - q[:, k + 1] for k, own in enumerate(reported)))
    total = sum(own[n:] for own in reported)
    rows, T = total[1:] - s, problem.temperature
    program = {
        "x": ca.vertcat(ca.vec(q), ca.vec(u), s),
        "f": total[0] + s,
        "g": ca.vertcat(gaps, T * ca.logsumexp(rows / T) if T else rows),
    }
    lower, upper = (
        np.append(bound, side) for bound, side in zip(_bounds(problem), (-np.inf, np.inf))
    )
    least = np.where(np.arange(program["g"].numel()) < n * stages, 0.0, -np.inf)
    solver = ca.nlpsol("epigraph", "ipopt", program, _OPTIONS)
    values = ca.Function("values", [program["x"]], [total[1:]])
    if T:
        start = epigraph(replace(problem, temperature=0.0)).point
    else:
        line = interpolated_guess(problem)
        start = np.append(_pack(line.q, line.u), 0.0)
        start[-1] = float(values(start).full().max())
    answer = solver(x0=start, lbx=lower, ubx=upper, lbg=least, ubg=0)
    assert solver.stats()["success"]
    largest, level = values(answer["x"]).full().ravel(), float(answer["x"][-1])
    return Epigraph(
        objective=float(answer["f"]),
        shares=np.exp((largest - level) / T) if T else answer["lam_g"].full().ravel()[n * stages :],
        values=largest,
        point=answer["x"].full().ravel(),
    )
