"""One settled run of the paper's example: our integrator, SciPy's solvers, CasADi's CVODES.

CVODES gets the same frozen network, written node by node as a CasADi graph with its exact sparse
Jacobian, and integrates to the network time at which the residual has settled to the same
tolerance. Two wirings, because they favour different solvers: coordinators shorten the run but
fill the Jacobian. Medians of CPU times, in one run, because machines drift.
"""

import os
import time
from collections.abc import Iterator

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import casadi as ca
import numpy as np
from bench.figure import Figure, show

import ann_dc
from ann_dc.evaluation import FUNCTION, PRODUCT, CompiledEvaluator, evaluator
from ann_dc.network.metrics import Kind

REPEATS = 9
FUNCTIONS = {0: ca.sin, 1: ca.cos, 2: ca.tan}


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
    metric = evaluator(network).metric.tocoo()
    shape = ca.Sparsity.triplet(
        network.size, network.size, metric.row.tolist(), metric.col.tolist())  # fmt: skip
    order = np.lexsort((metric.row, metric.col))
    return x, ca.mtimes(ca.DM(shape, metric.data[order].tolist()), drive)


def median_ms(call) -> float:
    """Median CPU time in milliseconds after one warm-up."""
    call()
    times = []
    for _ in range(REPEATS):
        began = time.process_time()
        call()
        times.append(time.process_time() - began)
    return 1e3 * float(np.median(times))


def scipy_rows(network, settling: ann_dc.Settling) -> tuple[list[tuple], float]:
    """A row for every method, and the network time that the slowest of them needed."""
    kernel, rows, end = CompiledEvaluator(network), [], 0.0
    for name, method in ann_dc.ode.METHODS.items():
        backend = ann_dc.OdeBackend(method=method, settling=settling, verify=False)
        run = backend.run(network)
        end = max(end, run.status.time) if run.status.settled else end
        ms = median_ms(lambda b=backend: b.run(network))
        who = "compiled" if method is ann_dc.ode.COMPILED else f"SciPy {name}"
        rows.append((who, ms, run.steps, max(kernel.residuals(run.trajectory.final))))
    return rows, end


def cvodes_rows(network, end: float) -> list[tuple]:
    """A row for CVODES with each multistep family and each pair of tolerances."""
    kernel, rows = CompiledEvaluator(network), []
    x, flow = casadi_flow(network)
    reference = evaluator(network).rhs(network.start_state)
    error = np.abs(np.array(ca.Function("f", [x], [flow])(network.start_state)).ravel() - reference)
    assert error.max() < 1e-10 * np.abs(reference).max(), "the CasADi graph is another network"
    for family in ("bdf", "adams"):
        for rtol, atol in ((1e-6, 1e-10), (1e-6, 1e-8)):
            options = {"abstol": atol, "reltol": rtol, "linear_multistep_method": family}
            integrator = ca.integrator("cvodes", "cvodes", {"x": x, "ode": flow}, 0, end, options)
            solve = lambda i=integrator: i(x0=network.start_state)  # noqa: E731
            final = np.array(solve()["xf"]).ravel()
            name = f"CVODES {family} {rtol:g} {atol:g}"
            rows.append((name, median_ms(solve), "-", max(kernel.residuals(final))))
    return rows


def figures() -> Iterator[Figure]:
    """One a solver and wiring."""
    for wiring, kind in (
        ("with coordinators", Kind.PYRAMID),
        ("neighbours only", Kind.TIME_CONSTANTS),
    ):
        network = ann_dc.design(ann_dc.plants.car(), kinds=[kind]).network
        rows, end = scipy_rows(network, ann_dc.Settling())
        for name, ms, steps, residual in [*rows, *cvodes_rows(network, end)]:
            counted = "" if steps == "-" else f"{steps} steps; "
            yield Figure(
                name=f"settled run of the car {wiring}, {name}",
                value=f"{ms:.1f} ms",
                remark=f"{counted}KKT residual {residual:.1e} at the end",
            )


if __name__ == "__main__":
    raise SystemExit(show(figures()))
