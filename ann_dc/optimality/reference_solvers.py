"""The same problem on this CPU: IPOPT and fatrop through CasADi, for the price of a circuit.

fatrop is an interior-point method that exploits the stages, the fastest free solver of its kind: a
circuit that is compared with IPOPT alone is compared with the wrong one.
"""

from __future__ import annotations

import math
import time as clock
from dataclasses import dataclass
from typing import Any

import numpy as np

from ann_dc.hints.checked import checked
from ann_dc.problem.declaration import OptimalControlProblem

_FUNCTIONS = (
    "sin", "cos", "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh", "exp", "log", "sqrt",
)  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class SolverTiming:
    """What a solver took for a problem.

    Attributes
    ----------
    name : str
        ``"IPOPT"`` or ``"fatrop"``.
    seconds : float
        Median of a solve.
    iterations : int
    objective : float
        What it found, in the user's units.
    """

    name: str
    seconds: float
    iterations: int
    objective: float


@checked
def time_solvers(problem: OptimalControlProblem, repeats: int = 20) -> tuple[SolverTiming, ...]:
    """Time the solvers that are there, from a straight line to the target.

    Parameters
    ----------
    problem : OptimalControlProblem
    repeats : int
        Solves a solver; the median counts.

    Returns
    -------
    tuple of SolverTiming
        Empty without CasADi (``pip install 'ann_dc[reference]'``); solvers that fail are left out.

    References
    ----------
    .. [1] A. Wächter, L. T. Biegler, On the implementation of an interior-point filter line-search
       algorithm for large-scale nonlinear programming, Mathematical Programming 106, 2006, 25-57.
    .. [2] L. Vanroye, A. Sathya, J. De Schutter, W. Decré, FATROP: a fast constrained optimal
       control problem solver for robot trajectory optimization and control, IROS 2023.

    Examples
    --------
    >>> from ann_dc import plants
    >>> timings = time_solvers(plants.double_integrator(N=5), repeats=1)
    >>> all(round(timing.objective, 6) == 500 for timing in timings)
    True
    """
    try:
        import casadi as ca
    except ImportError:
        return ()
    program, bounds = _program(ca, problem)
    equalities = [True] * program["g"].numel()
    known = {
        "IPOPT": ("ipopt", {"ipopt": {"print_level": 0, "sb": "yes"}, "expand": True}),
        "fatrop": (
            "fatrop",
            {
                "structure_detection": "auto",
                "equality": equalities,
                "expand": True,
                "fatrop": {"print_level": 0},
            },
        ),
    }
    found = (_timed(ca, name, *how, program, bounds, repeats) for name, how in known.items())
    return tuple(timed for timed in found if timed is not None)


def _timed(ca: Any, name: str, plugin: str, options: dict, program, bounds, repeats: int):
    try:
        solver = ca.nlpsol("timed", plugin, program, {"print_time": False, **options})
        answer, times = solver(**bounds), []
        for _ in range(repeats):
            began = clock.perf_counter()
            solver(**bounds)
            times.append(clock.perf_counter() - began)
        stats = solver.stats()
    except RuntimeError:  # a build of CasADi without this plugin
        return None
    if not stats["success"]:
        return None
    return SolverTiming(
        name=name,
        seconds=float(np.median(times)),
        iterations=int(stats["iter_count"]),
        objective=float(answer["f"]),
    )


def _program(ca: Any, problem: OptimalControlProblem) -> tuple[dict, dict]:
    """Multiple shooting, ordered by stage as fatrop wants it."""
    n, m, N = problem.n, problem.m, problem.horizon
    step, cost, terminal = _functions(ca, problem)
    given = [np.broadcast_to(value, N) for value in problem.inputs.values()]
    inputs = np.array(given, float).reshape(len(given), N)
    q = [ca.SX.sym(f"q{k}", n) for k in range(N + 1)]
    u = [ca.SX.sym(f"u{k}", m) for k in range(N)]
    line = np.linspace(*problem.ends, N + 1)
    given = [i for i, fixed in enumerate(problem.fixed_start) if fixed]
    variables, guess, constraints = [], [], []
    objective = terminal(q[N], inputs[:, N - 1])
    for k in range(N):
        variables += [q[k], u[k]]
        guess += [*line[k], *np.zeros(m)]
        constraints.append(q[k + 1] - step(q[k], u[k], inputs[:, k]))
        if k == 0:
            constraints.append((q[0] - line[0])[given])
        objective += cost(q[k], u[k], inputs[:, k])
    fixed = [(i, value) for i, value in enumerate(problem.q_d or ()) if value is not None]
    constraints += [q[N][i] - value for i, value in fixed]
    program = {
        "x": ca.vertcat(*variables, q[N]),
        "f": objective,
        "g": ca.vertcat(*constraints),
    }
    return program, {"x0": np.array([*guess, *line[N]]), "lbg": 0.0, "ubg": 0.0}


def _functions(ca: Any, problem: OptimalControlProblem):
    """Map, stage cost and terminal cost as CasADi functions."""
    q, u = ca.SX.sym("q", problem.n), ca.SX.sym("u", problem.m)
    inputs = ca.SX.sym("inputs", len(problem.inputs))
    parts = [*ca.vertsplit(q), *ca.vertsplit(u), *(ca.vertsplit(inputs) if problem.inputs else ())]
    table = {name: getattr(ca, name) for name in _FUNCTIONS}
    step, cost, terminal = (
        ca.vertcat(*function(*parts))
        for function in problem.functions.in_library([table, vars(math)])
    )
    return (
        ca.Function("map", [q, u, inputs], [step]),
        ca.Function("cost", [q, u, inputs], [cost]),
        ca.Function("terminal", [q, inputs], [terminal]),
    )
