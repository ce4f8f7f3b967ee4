"""Cost of one compiled right-hand side, from inside compiled code. `make bench`.

The car at N = 9, 90, 900 (same dt): microseconds a call, and nanoseconds a cell, which stay flat.
"""

import time

import numba as nb
import numpy as np

import ann_dc
from ann_dc.analysis.linearisation import Linearisation
from ann_dc.evaluation import loops
from ann_dc.evaluation.compiled import CompiledEvaluator
from ann_dc.gain_design.gains import apply_gains
from ann_dc.gain_design.recipe import WITH_COORDINATORS, closed_form

REPEATS = 7


@nb.njit
def many(tape, work, x, out, count):
    """``count`` right-hand sides in a row."""
    for _ in range(count):
        loops.rhs(tape, work, x, out)
        x[0] += 1e-12 * out[0]  # so that no call can be dropped


def microseconds(network) -> float:
    """Median over repeats of the time of one call."""
    evaluator = CompiledEvaluator(network)
    x, out = network.start_state.copy(), np.empty(network.size)
    count = max(20_000 // network.stages, 20)
    many(evaluator.tape, evaluator.work, x, out, 1)
    times = []
    for _ in range(REPEATS):
        began = time.perf_counter()
        many(evaluator.tape, evaluator.work, x, out, count)
        times.append((time.perf_counter() - began) / count)
    return 1e6 * float(np.median(times))


def main() -> None:
    """Print the table."""
    print(f"{'N':>5} {'neurons':>8} {'plain us':>9} {'with coordinators us':>21} {'ns a cell':>10}")
    for stages in (9, 90, 900):
        plain = ann_dc.synthesize(ann_dc.plants.car(N=stages))
        linear = Linearisation(plain).at(plain.start_state)
        coarse = apply_gains(plain, closed_form(linear, WITH_COORDINATORS))
        bare, full = microseconds(plain), microseconds(coarse)
        print(f"{stages:5} {plain.size:8} {bare:9.2f} {full:21.2f} {1e3 * full / stages:10.0f}")


if __name__ == "__main__":
    main()
