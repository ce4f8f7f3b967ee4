"""Reference solutions and CPU times of IPOPT and fatrop through CasADi.

IPOPT's optimum includes its multipliers, so a certificate can be compared with it. fatrop is an
interior-point method that exploits the stage structure and is the fastest free solver of its kind;
a circuit should not be compared with IPOPT alone.

A soft constraint has two slacks per stage, placed after the controls: g <= s + y, at a cost of P s
+ y^2 / (2 d). Its multiplier is zeta.
"""

from __future__ import annotations

import math
import time as clock
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ann_dc.errors import ProblemError
from ann_dc.network.functions import ARITHMETIC, ELEMENTARY, FUNCTIONS, folded
from ann_dc.optimality.soft_constraints import Slacks
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.validation import checked

_EXACT = {
    "print_time": False,
    "expand": True,
    "ipopt": {
        "print_level": 0,
        "sb": "yes",
        "max_iter": 3000,
        "bound_relax_factor": 0.0,
    },
}
"""Options without the relaxation of bounds that IPOPT applies by default."""
_TOLERANCES = 1e-12, 1e-9
"""Tolerances; the second applies if rounding ends the search with the first."""


@dataclass(frozen=True, kw_only=True)
class SolverTiming:
    """Median time in seconds of a solver (``"IPOPT"`` or ``"fatrop"``) for a problem.

    `objective` is that of its solution, in the user's units.
    """

    name: str
    seconds: float
    iterations: int
    objective: float


@checked
@dataclass(frozen=True, kw_only=True, eq=False)
class SolverIterates:
    """Iterations of a digital solver on a problem, from a straight line to the target.

    Attributes
    ----------
    name : str
        Name of the solver.
    seconds : float
        Time of one solve.
    residuals : (J + 1,) array
        Larger of the solver's primal and dual infeasibility before every iteration and at the end.
    objectives : (J + 1,) array
        Costs in the user's units.
    """

    name: str
    seconds: float
    residuals: np.ndarray
    objectives: np.ndarray


@checked
def solver_iterates(problem: OptimalControlProblem) -> SolverIterates:
    """Return the iterations of IPOPT on a problem.

    Raises `ProblemError` without CasADi (``pip install 'ann_dc[reference]'``).

    Examples
    --------
    >>> from ann_dc import plants
    >>> found = solver_iterates(plants.double_integrator(N=5))
    >>> bool(found.residuals[-1] < 1e-8), round(float(found.objectives[-1]), 6)
    (True, 500.0)
    """
    try:
        import casadi as ca
    except ImportError as error:
        raise ProblemError(
            "solver_iterates: IPOPT runs through CasADi: pip install 'ann_dc[reference]'"
        ) from error
    shooting = _Shooting.of(ca, problem)
    options = {"ipopt": {"print_level": 0, "sb": "yes"}, "expand": True, "print_time": False}
    solver, bounds = ca.nlpsol("iterates", "ipopt", shooting.program, options), shooting.bounds()
    began = clock.perf_counter()
    solver(**bounds)
    seconds, steps = clock.perf_counter() - began, solver.stats()["iterations"]
    return SolverIterates(
        name="IPOPT",
        seconds=seconds,
        residuals=np.maximum(steps["inf_pr"], steps["inf_du"]),
        objectives=np.array(steps["obj"], float),
    )


@checked
def time_solvers(problem: OptimalControlProblem, repeats: int = 20) -> tuple[SolverTiming, ...]:
    """Time the installed reference solvers, starting on a straight line to the target.

    Parameters
    ----------
    problem : OptimalControlProblem
        Problem to solve.
    repeats : int
        Number of solves per solver; the median is reported. Default 20.

    Returns
    -------
    tuple of SolverTiming
        Empty without CasADi (``pip install 'ann_dc[reference]'``); solvers that fail are omitted.

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
    shooting = _Shooting.of(ca, problem)
    program, bounds = shooting.program, shooting.bounds()
    equalities = [kind != "row" for kind in shooting.kinds]
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


@dataclass(frozen=True, kw_only=True, eq=False)
class ReferencePoint:
    """Optimum found by IPOPT with its multipliers, in the user's units.

    q, t, mu and beta are (n, N), u is (m, N), zeta (r, N) and zeta_end (r_e,); t are the states
    after each stage.
    """

    objective: float
    q: np.ndarray
    u: np.ndarray
    t: np.ndarray
    mu: np.ndarray
    beta: np.ndarray
    zeta: np.ndarray
    zeta_end: np.ndarray

    @property
    def kkt(self) -> tuple[np.ndarray, ...]:
        """Arguments of `certify` after the problem."""
        return self.q, self.u, self.t, self.mu, self.beta, self.zeta, self.zeta_end


@checked
def ipopt_point(
    problem: OptimalControlProblem, q: np.ndarray | None = None, u: np.ndarray | None = None
) -> ReferencePoint | None:
    """Return IPOPT's optimum of a problem, to the smallest tolerance it reaches.

    The initial guess is `q` (n, N+1), by default a straight line to the target, and `u` (m, N), by
    default zero. Returns None if no optimum is found or CasADi is not installed.

    Examples
    --------
    >>> from ann_dc import plants
    >>> from ann_dc.optimality import certify
    >>> problem = plants.double_integrator(N=5)
    >>> found = ipopt_point(problem)
    >>> found is None or certify(problem, *found.kkt).certified
    True
    """
    try:
        import casadi as ca
    except ImportError:
        return None
    shooting = _Shooting.of(ca, problem)
    for tolerance in _TOLERANCES:
        limits = {"tol": tolerance, "compl_inf_tol": tolerance}
        options = {**_EXACT, "ipopt": {**_EXACT["ipopt"], **limits}}
        solver = ca.nlpsol("reference", "ipopt", shooting.program, options)
        answer = solver(**shooting.bounds(q, u))
        if solver.stats()["success"]:
            return shooting.point(answer)
    return None


@dataclass(frozen=True, kw_only=True, eq=False)
class _Shooting:
    """Multiple shooting program, ordered by stage as fatrop requires.

    `program` is the argument of `casadi.nlpsol`. `kinds` names the kind of each constraint: "map",
    "end" (fixed), "row" or "last".
    """

    problem: OptimalControlProblem
    program: dict
    kinds: list[str]
    slack: Slacks
    end_slack: Slacks

    @classmethod
    def of(cls, ca: Any, problem: OptimalControlProblem) -> _Shooting:
        n, m, N = problem.n, problem.m, problem.horizon
        step, cost, terminal, rows, end_rows = _functions(ca, problem)
        given = [np.broadcast_to(value, N) for value in problem.inputs.values()]
        inputs = np.array(given, float).reshape(len(given), N)
        q = [ca.SX.sym(f"q{k}", n) for k in range(N + 1)]
        u = [ca.SX.sym(f"u{k}", m) for k in range(N)]
        slack, end_slack = Slacks.of(problem.inequalities), Slacks.of(problem.end_inequalities)
        s = [ca.SX.sym(f"s{k}", slack.count) for k in range(N)]
        s.append(ca.SX.sym(f"s{N}", end_slack.count))
        first, last = problem.ends
        parts: list[tuple[str, Any]] = []
        for k in range(N):
            parts.append(("map", q[k + 1] - step(q[k], u[k], inputs[:, k])))
            if k == 0:
                parts.append(("end", (q[0] - first)[_places(problem.fixed_start)]))
            parts.append(("row", rows(q[k], u[k], inputs[:, k]) - ca.mtimes(slack.share, s[k])))
        parts.append(("end", (q[N] - last)[_places(problem.fixed)]))
        beyond = ca.mtimes(end_slack.share, s[N])
        parts.append(("last", end_rows(q[N], inputs[:, N - 1]) - beyond))
        parts = [(kind, part) for kind, part in parts if part.numel()]  # some are 1 x 0: one row
        stages = [cost(q[k], u[k], inputs[:, k]) + slack.cost(ca, s[k]) for k in range(N)]
        at_end = terminal(q[N], inputs[:, N - 1]) + end_slack.cost(ca, s[N])
        program = {
            "x": ca.vertcat(*(part for stage in zip(q, u, s) for part in stage), q[N], s[N]),
            "f": sum(stages) + at_end,
            "g": ca.vertcat(*(part for _, part in parts)),
        }
        kinds = [kind for kind, part in parts for _ in range(part.numel())]
        slacks = {"slack": slack, "end_slack": end_slack}
        return cls(problem=problem, program=program, kinds=kinds, **slacks)

    def bounds(self, q: np.ndarray | None = None, u: np.ndarray | None = None) -> dict:
        """Return the call arguments: initial guess (n, N+1) and (m, N), and all limits."""
        problem = self.problem
        low, high = problem.control_limits.T
        line = np.linspace(*problem.ends, problem.horizon + 1).T if q is None else q
        still = np.zeros((problem.m, problem.horizon)) if u is None else u
        is_row, free = np.isin(self.kinds, ("row", "last")), np.full_like(line, np.inf)
        return {
            "x0": self._by_stage(line, still, 0.0),
            "lbx": self._by_stage(-free, np.full_like(still, low[:, None]), 0.0),
            "ubx": self._by_stage(free, np.full_like(still, high[:, None]), np.inf),
            "lbg": np.where(is_row, -np.inf, 0.0),
            "ubg": 0.0,
        }

    def _by_stage(self, q: np.ndarray, u: np.ndarray, slack: float) -> np.ndarray:
        """Return states (n, N+1), controls (m, N) and slacks in the program's order."""
        of_stages = np.full((self.slack.count, u.shape[1]), slack)
        end = np.full(self.end_slack.count, slack)
        return np.concatenate([np.concatenate([q[:, :-1], u, of_stages]).T.ravel(), q[:, -1], end])

    def point(self, answer: Any) -> ReferencePoint:
        """Return a solver's result in the variables of a certificate."""
        n, m, N = self.problem.n, self.problem.m, self.problem.horizon
        x, dual = (answer[name].full().ravel() for name in ("x", "lam_g"))
        width = n + m + self.slack.count
        stages, q_N = x[: N * width].reshape(N, width).T, x[N * width :][:n]
        of = {kind: dual[np.array(self.kinds) == kind] for kind in ("map", "row", "last")}
        mu = -of["map"].reshape(N, n).T
        return ReferencePoint(
            objective=float(answer["f"]),
            q=stages[:n],
            t=np.column_stack([stages[:n, 1:], q_N]),
            u=stages[n : n + m],
            mu=mu,
            beta=np.column_stack([np.zeros(n), -mu[:, :-1]]),
            zeta=of["row"].reshape(N, -1).T,
            zeta_end=of["last"],
        )


def _places(fixed: Sequence[bool]) -> list[int]:
    return [i for i, is_fixed in enumerate(fixed) if is_fixed]


def _functions(ca: Any, problem: OptimalControlProblem):
    """Return dynamics, stage cost, terminal cost and inequalities as CasADi functions."""
    if problem.objectives:
        raise ProblemError(
            f"objectives: {problem.name} has {', '.join(problem.objective_names)}, and the "
            "reference solvers support one cost; compare points by their certificates"
        )
    q, u = ca.SX.sym("q", problem.n), ca.SX.sym("u", problem.m)
    inputs = ca.SX.sym("inputs", len(problem.inputs))
    parts = [*ca.vertsplit(q), *ca.vertsplit(u), *(ca.vertsplit(inputs) if problem.inputs else ())]
    library = ARITHMETIC | {name: getattr(ca, name) for name in ELEMENTARY.values()}
    table = {
        block.name: lambda x, block=block: folded(block.trees[0], {"x": x}, library)
        for block in FUNCTIONS
        if block.in_expressions
    }
    step, cost, terminal, rows, end_rows = (
        ca.vertcat(*function(*parts))
        for function in problem.functions.in_library([table, vars(math)])
    )
    return (
        ca.Function("map", [q, u, inputs], [step]),
        ca.Function("cost", [q, u, inputs], [cost]),
        ca.Function("terminal", [q, inputs], [terminal]),
        ca.Function("rows", [q, u, inputs], [rows]),
        ca.Function("end_rows", [q, inputs], [end_rows]),
    )
