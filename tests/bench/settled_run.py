"""One settled run of the paper's example, against CVODES, fatrop, IPOPT and SQP.

The network is frozen with every kind of preconditioner. Ours integrate until the KKT residual has
fallen to 5e-9. CVODES gets the same network, node by node as a CasADi graph with its exact sparse
Jacobian, ends when ours do, and may choose its tolerances as long as its residual is then below
5e-9 too; it has time constants alone, with which that Jacobian is sparse, and a pyramid. The other
solvers get the problem itself. What counts is the least CPU time of rounds in which all take turns.
"""

import os
import sys
from collections.abc import Iterator
from dataclasses import replace

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from bench.figure import Figure, picture, show
from bench.in_turns import Contestant, in_turns
from bench.rivals import COMPILER, integrators, programs, scratch

import ann_dc
from ann_dc.backends import ode
from ann_dc.backends.integration.systems import Cells
from ann_dc.evaluation.interpreted import InterpretedEvaluator
from ann_dc.network.preconditioners.base import PreconditionerKind

INTERPRETED, GENERATED = Cells.INTERPRETED, Cells.GENERATED
LOOSE = replace(ode.COMPILED, rtol=1e-4, atol=1e-8)
OURS = {
    "generated cells": {"cells": GENERATED},
    "generated cells, rtol 1e-4": {"cells": GENERATED, "method": LOOSE},
    "generated cells, verified": {"cells": GENERATED, "verify": True},
    "interpreted cells": {"cells": INTERPRETED},
    "interpreted cells, rtol 1e-4": {"cells": INTERPRETED, "method": LOOSE},
    "SciPy DOP853": {"method": ode.DOP853},
    "SciPy RK45": {"method": ode.RK45},
    "SciPy LSODA": {"method": ode.LSODA},
}
"""Settings of `OdeBackend`, the first of which say when CVODES may end."""
WIRINGS = {
    "settled run of the car, diagonal": PreconditionerKind.DIAGONAL,
    "settled run of the car, multilevel": PreconditionerKind.MULTILEVEL,
    "settled run of the car, resistive grid": PreconditionerKind.RESISTIVE_GRID,
    "settled run of the car, cyclic reduction": PreconditionerKind.CYCLIC_REDUCTION,
}
FOR_CVODES = ("settled run of the car, diagonal", "settled run of the car, multilevel")
SETTLED = ann_dc.Settling().tolerance * ann_dc.Settling().confirm


def own(network) -> Iterator[tuple[Contestant, float]]:
    """Whole runs of a network, as a user asks for them, and the network times of their ends."""
    kernel = InterpretedEvaluator(network)
    for name, chosen in OURS.items():
        backend = ann_dc.OdeBackend(**{"verify": False} | chosen)
        run = backend.run(network)
        residual = max(kernel.residuals(run.trajectory.final))
        assert run.status.settled, f"{name}: {run.status}"
        assert residual < SETTLED, f"{name}: settled at {residual:.1e}"
        remark = f"{run.steps} steps; KKT residual {residual:.1e} at the end"
        call = lambda b=backend: b.run(network)  # noqa: E731
        yield Contestant(name=name, call=call, remark=remark), run.status.time


def contestants(problem) -> Iterator[tuple[str, Contestant]]:
    """Everybody, with what they work on."""
    for wiring, kind in WIRINGS.items():
        network = ann_dc.design(problem, preconditioner=[kind]).network
        runs = [*own(network)]
        yield from ((wiring, one) for one, _ in runs)
        if wiring in FOR_CVODES:
            yield from ((wiring, one) for one in integrators(network, runs[0][1], SETTLED))
    objective = ann_dc.solve(problem).certificate.objective
    yield from (("the problem of the car", one) for one in programs(problem, objective))


def figures() -> Iterator[Figure]:
    """One a contestant; the last says whether there was a compiler for CasADi."""
    with scratch():
        everybody = [*contestants(ann_dc.plants.car())]
        in_turns([one for _, one in everybody])
    for on, one in everybody:
        yield Figure(
            name=f"{on}: {one.name}", value=one.value, remark=one.times, number=1e3 * min(one.cpu)
        )
    if COMPILER is None:
        yield Figure(name="CasADi's compiled code", value="-", remark="there is no C compiler here")


if __name__ == "__main__":
    measured = [*figures()]
    if len(sys.argv) > 1:
        picture(measured, sys.argv[1], "Settled, or solved to 1e-8: CPU time (ms)")
    raise SystemExit(show(measured))
