"""CasADi's solvers on what our networks solve: the same equations, or the same problem.

Whatever CasADi computes is computed by its interpreter, or by code that a C compiler has made of it
(`JIT`), which takes seconds once and is not timed.
"""

from __future__ import annotations

import contextlib
import os
import shutil
import tempfile
from collections.abc import Iterator
from functools import partial

import casadi as ca
import numpy as np
from bench.in_turns import Contestant, in_turns
from reference import casadi_functions

from ann_dc.evaluation.interpreted import InterpretedEvaluator
from ann_dc.evaluation.reference import evaluator
from ann_dc.evaluation.tape import FUNCTION, PRODUCT
from ann_dc.problem.initial_guess import interpolated_guess

FUNCTIONS = {0: ca.sin, 1: ca.cos, 2: ca.tan}
TOLERANCES = tuple((rtol, atol) for rtol in (1e-4, 1e-6) for atol in (1e-8, 1e-9, 1e-10, 1e-11))
COMPILER = next((name for name in ("gcc", "clang") if shutil.which(name)), None)
JIT = {
    "jit": True,
    "compiler": "shell",
    "jit_cleanup": False,  # the folder goes, with all that is in it
    "jit_options": {"compiler": COMPILER, "flags": ["-O3"], "cleanup": False},
}
QUIET = {"print_time": False, "expand": True}
PROGRAMS = {
    "fatrop": ("fatrop", {"structure_detection": "auto", "fatrop": {"print_level": 0}}),
    "IPOPT": ("ipopt", {"ipopt": {"print_level": 0, "sb": "yes", "tol": 1e-8}}),
    "SQP with qrqp": (
        "sqpmethod",
        {
            "qpsol": "qrqp",
            "qpsol_options": {"print_iter": False, "print_header": False, "error_on_fail": False},
            "print_iteration": False,
            "print_header": False,
            "print_status": False,
            "tol_pr": 1e-8,
            "tol_du": 1e-8,
        },
    ),
}


@contextlib.contextmanager
def scratch() -> Iterator[None]:
    """A folder for what the C compiler leaves behind."""
    before = os.getcwd()
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        try:
            yield
        finally:
            os.chdir(before)


# ---- the same equations --------------------------------------------------------------------------


def casadi_flow(network) -> tuple[ca.SX, ca.SX]:
    """(x, dx/ds) of a network as a CasADi graph, from its tape."""
    tape, stages = evaluator(network).tape, network.stages
    x = ca.SX.sym("x", network.size)
    values = [[ca.SX(v) for v in row] for row in tape.values]
    for i, (neuron, stage) in enumerate(tape.places):
        values[neuron][stage + 1] = x[i]

    def arriving(first, last, k):
        edges = range(first, last)
        return sum(
            (tape.weights[e, k] * values[tape.sources[e, 0]][k + 1 + tape.sources[e, 1]]
             for e in edges), ca.SX(0))  # fmt: skip

    for kind, node, a, b in tape.blocks:
        for k in range(stages):
            if kind == PRODUCT:
                values[node][k + 1] = values[a][k + 1] * values[b][k + 1]
            elif kind == FUNCTION:
                values[node][k + 1] = FUNCTIONS[a](values[b][k + 1])
            else:
                values[node][k + 1] = arriving(a, b, k)
    drive = ca.vertcat(*(arriving(*tape.drives[neuron], stage) for neuron, stage in tape.places))
    preconditioner = evaluator(network).preconditioner.tocoo()
    shape = ca.Sparsity.triplet(
        network.size, network.size,
        preconditioner.row.tolist(), preconditioner.col.tolist())  # fmt: skip
    order = np.lexsort((preconditioner.row, preconditioner.col))
    return x, ca.mtimes(ca.DM(shape, preconditioner.data[order].tolist()), drive)


def integrators(network, end: float, settled: float) -> Iterator[Contestant]:
    """CVODES on a network, to a time at which it has settled: the loosest tolerances that have.

    Of each multistep family the fastest pair of `TOLERANCES` whose end has a residual below
    ``settled``; interpreted, and compiled.
    """
    kernel, start = InterpretedEvaluator(network), network.start_state
    x, flow = casadi_flow(network)
    error = np.abs(np.array(ca.Function("f", [x], [flow])(start)).ravel() - kernel.rhs(start))
    assert error.max() < 1e-10 * np.abs(kernel.rhs(start)).max(), "the graph is another network"

    def made(family: str, rtol: float, atol: float, how: dict) -> Contestant:
        options = {"abstol": atol, "reltol": rtol, "linear_multistep_method": family, **how}
        run = ca.integrator("cvodes", "cvodes", {"x": x, "ode": flow}, 0, end, options)
        residual = max(kernel.residuals(np.array(run(x0=start)["xf"]).ravel()))
        remark = f"tolerances {rtol:g}, {atol:g}; KKT residual {residual:.1e} at the end"
        name = f"CVODES {family}, {'compiled' if how else 'interpreted'}"
        contestant = Contestant(name=name, call=partial(run, x0=start), remark=remark)
        return contestant if residual < settled else Contestant(name=name, call=lambda: None)

    for family in ("bdf", "adams"):
        tried = [(pair, made(family, *pair, {})) for pair in TOLERANCES]
        tried = [(pair, one) for pair, one in tried if one.remark]
        if not tried:
            continue
        pair, best = min(tried, key=lambda both: least_seconds(both[1]))
        yield best
        if COMPILER is not None:
            yield made(family, *pair, JIT)


def least_seconds(contestant: Contestant, repeats: int = 3) -> float:
    """Of a few calls by itself."""
    trial = Contestant(name="", call=contestant.call)
    in_turns([trial], repeats)
    return min(trial.cpu)


# ---- the same problem ----------------------------------------------------------------------------


def programs(problem, objective: float) -> Iterator[Contestant]:
    """Solvers of the nonlinear program, from where the network starts too, to 1e-8.

    ``objective`` is that of the optimum which all of them have to find.
    """
    program, bounds = program_of(problem)
    equality = {"equality": [True] * program["g"].numel()}
    for name, (plugin, own) in PROGRAMS.items():
        for how in ({}, JIT) if COMPILER is not None else ({},):
            options = QUIET | own | how | (equality if plugin == "fatrop" else {})
            solver = ca.nlpsol("solver", plugin, program, options)
            answer, stats = solver(**bounds), solver.stats()
            gap = abs(float(answer["f"]) / objective - 1)
            ended = f"{stats['iter_count']} iterations; objective off by {gap:.0e}"
            if not stats["success"] or gap > 1e-6:
                ended = f"DOES NOT SOLVE IT: {stats['return_status']}, {ended}"
            yield Contestant(
                name=f"{name}, {'compiled' if how else 'interpreted'}",
                call=partial(solver, **bounds),
                remark=ended,
            )


def program_of(problem) -> tuple[dict, dict]:
    """Multiple shooting of a problem without inputs whose ends are given; by stage, for fatrop."""
    n, m, N = problem.n, problem.m, problem.horizon
    step, cost, terminal = casadi_functions(problem)
    none = ca.DM(0, 1)
    q = [ca.SX.sym(f"q{k}", n) for k in range(N + 1)]
    u = [ca.SX.sym(f"u{k}", m) for k in range(N)]
    start = interpolated_guess(problem)
    line, controls = start.q.T, start.u.T
    variables, guess, constraints = [], [], []
    for k in range(N):
        variables += [q[k], u[k]]
        guess += [*line[k], *controls[k]]
        constraints.append(q[k + 1] - step(q[k], u[k], none))
        if k == 0:
            constraints.append(q[0] - line[0])
    constraints.append(q[N] - line[N])
    total = sum(cost(q[k], u[k], none) for k in range(N)) + terminal(q[N], none)
    program = {"x": ca.vertcat(*variables, q[N]), "f": total, "g": ca.vertcat(*constraints)}
    return program, {"x0": np.array([*guess, *line[N]]), "lbg": 0.0, "ubg": 0.0}
