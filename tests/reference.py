"""The independent solver: multiple shooting through CasADi and IPOPT.

Nothing of ann_dc is used but the declaration itself, so a shared mistake cannot hide here.
"""

import math
from dataclasses import dataclass

import casadi as ca
import numpy as np
import sympy as sp

_NAMES = "sin cos tan asin acos atan sinh cosh tanh exp log sqrt"
_CASADI = {name: getattr(ca, name) for name in _NAMES.split()}
_OPTIONS = {
    "print_time": False,
    "ipopt": {
        "print_level": 0,
        "sb": "yes",
        "tol": 1e-10,
        "max_iter": 3000,
        "bound_relax_factor": 0.0,
    },
}

_SHARP = {"compl_inf_tol": 1e-10}
"""What a slack costs may be little."""


@dataclass(frozen=True)
class Reference:
    """What IPOPT found: states ``q`` (n, N+1), controls ``u`` (m, N) and their objective."""

    objective: float
    q: np.ndarray
    u: np.ndarray
    success: bool


def ipopt(problem, guess=None, seed=None) -> Reference:
    """Solve from ``guess`` = (q, u), else from a line to the target, with noise if seeded."""
    n, m, N = problem.n, problem.m, problem.horizon
    q, u = ca.SX.sym("q", n, N + 1), ca.SX.sym("u", m, N)
    step, cost, terminal = casadi_functions(problem)
    row, end_row = inequality_functions(problem)
    inputs = _inputs(problem)
    gaps = [step(q[:, k], u[:, k], inputs[:, k]) - q[:, k + 1] for k in range(N)]
    rows = [row(q[:, k], u[:, k], inputs[:, k]) for k in range(N)]
    rows.append(end_row(q[:, N], inputs[:, N - 1]))
    rows, slacks, price = _softened(problem, rows)
    total = sum(cost(q[:, k], u[:, k], inputs[:, k]) for k in range(N))
    program = {
        "x": ca.vertcat(ca.vec(q), ca.vec(u), slacks),
        "f": total + terminal(q[:, N], inputs[:, N - 1]) + price,
        "g": ca.vertcat(*gaps, *rows),
    }
    options = _OPTIONS | {"ipopt": _OPTIONS["ipopt"] | (_SHARP if problem.soft else {})}
    solver = ca.nlpsol("reference", "ipopt", program, options)
    lower, upper = _bounds(problem)
    start = _pack(*(_start(problem, seed) if guess is None else guess))
    none, many = np.zeros(slacks.numel()), np.full(slacks.numel(), np.inf)
    start, lower, upper = (np.r_[a, b] for a, b in ((start, none), (lower, none), (upper, many)))
    least = np.where(np.arange(program["g"].numel()) < n * N, 0.0, -np.inf)
    answer = solver(x0=start, lbx=lower, ubx=upper, lbg=least, ubg=0)
    x = answer["x"].full().ravel()
    split = n * (N + 1)
    return Reference(
        objective=float(answer["f"]),
        q=x[:split].reshape(n, N + 1, order="F"),
        u=x[split : split + m * N].reshape(m, N, order="F"),
        success=bool(solver.stats()["success"]),
    )


def _softened(problem, rows):
    """Rows (one a stage, then the end) less their slacks, all slacks, and what they cost.

    A soft row is left by y, at y^2 / 2d, and by s, at the price.
    """
    kinds = [problem.inequalities] * (len(rows) - 1) + [problem.end_inequalities]
    slacks, cost, found = [ca.SX(0, 1)], ca.SX(0), []
    for row, kind in zip(rows, kinds):
        left = []
        for g, soft in zip(ca.vertsplit(row) if kind else (), (r.soft for r in kind)):
            if soft and math.isfinite(soft.weight):
                slacks.append(ca.SX.sym("s"))
                g, cost = g - slacks[-1], cost + soft.weight * slacks[-1]
            if soft and soft.compliance:
                slacks.append(ca.SX.sym("y"))
                g, cost = g - slacks[-1], cost + slacks[-1] ** 2 / (2 * soft.compliance)
            left.append(g)
        found.append(ca.vertcat(*left))
    return found, ca.vertcat(*slacks), cost


def best_of(problem, starts=6, seed=0) -> Reference:
    """The best of a plain start and ``starts - 1`` noisy ones."""
    runs = [ipopt(problem)] + [ipopt(problem, seed=seed + k) for k in range(1, starts)]
    solved = [run for run in runs if run.success]
    if not solved:
        raise RuntimeError(f"IPOPT solved {problem.name} from none of {starts} starts")
    return min(solved, key=lambda run: run.objective)


def casadi_functions(problem) -> tuple[ca.Function, ca.Function, ca.Function]:
    """(map, stage cost) of (q, u, inputs) and terminal cost of (q, inputs) as CasADi functions."""
    q, u, inputs, translate = _translator(problem)
    return (
        ca.Function("map", [q, u, inputs], [translate(problem.f)]),
        ca.Function("cost", [q, u, inputs], [translate([problem.l])]),
        ca.Function("terminal", [q, inputs], [translate([problem.l_N])]),
    )


def inequality_functions(problem) -> tuple[ca.Function, ca.Function]:
    """g of (q, u, inputs), and that of the end of (q, inputs), as CasADi functions."""
    q, u, inputs, translate = _translator(problem)
    rows = translate([row.expression for row in problem.inequalities])
    at_end = translate([row.expression for row in problem.end_inequalities])
    return ca.Function("rows", [q, u, inputs], [rows]), ca.Function("end", [q, inputs], [at_end])


def _translator(problem):
    """Symbols q, u and inputs of CasADi, and what turns expressions into its own."""
    q, u = ca.SX.sym("q", problem.n), ca.SX.sym("u", problem.m)
    inputs = ca.SX.sym("inputs", len(problem.inputs))
    values = dict(zip(problem.states, ca.vertsplit(q))) | dict(
        zip([*problem.controls, *problem.inputs], ca.vertsplit(u) + ca.vertsplit(inputs))
    )

    def translate(expressions):
        function = sp.lambdify(list(values), list(expressions), modules=[_CASADI, vars(math)])
        return ca.vertcat(*function(*values.values()))

    return q, u, inputs, translate


def _inputs(problem) -> ca.DM:
    rows = [np.broadcast_to(value, problem.horizon) for value in problem.inputs.values()]
    return ca.DM(np.reshape(rows, (len(rows), problem.horizon)))


def _bounds(problem) -> tuple[np.ndarray, np.ndarray]:
    """Every variable free but q_0, the fixed components of q_N and what limits controls."""
    lower = np.full((problem.n, problem.horizon + 1), -np.inf)
    lower[:, 0] = [-np.inf if value is None else value for value in problem.q_0]
    lower[:, -1] = [-np.inf if value is None else value for value in problem.q_d]
    upper = np.where(np.isinf(lower), np.inf, lower)
    least, most = (np.repeat(limits[:, None], problem.horizon, 1) for limits in _limits(problem))
    return _pack(lower, least), _pack(upper, most)


def _limits(problem) -> np.ndarray:
    return problem.control_limits.T


def _start(problem, seed) -> tuple[np.ndarray, np.ndarray]:
    ends = [*zip(problem.q_0, problem.q_d)]
    first = [(b or 0.0) if a is None else a for a, b in ends]
    last = [(a or 0.0) if b is None else b for a, b in ends]
    q = np.linspace(first, last, problem.horizon + 1).T
    u = np.zeros((problem.m, problem.horizon))
    u = np.clip(u.T, *_limits(problem)).T
    if seed is None:
        return q, u
    rng = np.random.default_rng(seed)
    return q + 0.3 * rng.normal(size=q.shape), u + rng.normal(size=u.shape)


def _pack(q, u) -> np.ndarray:
    return np.concatenate([np.ravel(q, order="F"), np.ravel(u, order="F")])
