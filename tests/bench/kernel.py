"""Cost of one compiled right-hand side, from inside compiled code.

The car at N = 9, 90, 900 (same dt): microseconds a call, and nanoseconds a cell, which stay flat.
CPU time, so that other processes count little.
"""

import time
from collections.abc import Iterator

import numba as nb
import numpy as np
from bench.figure import Figure, show

import ann_dc
from ann_dc.analysis.linearisation import Linearisation
from ann_dc.evaluation import loops
from ann_dc.evaluation.interpreted import InterpretedEvaluator
from ann_dc.gain_design.gain_rule import MULTILEVEL_RULE, closed_form
from ann_dc.gain_design.gains import apply_gains

REPEATS = 7


@nb.njit
def many(tape, work, x, out, count):
    """``count`` right-hand sides in a row."""
    for _ in range(count):
        loops.rhs(tape, work, x, out)
        x[0] += 1e-12 * out[0]  # so that no call can be dropped


def microseconds(network) -> float:
    """Median over repeats of the time of one call."""
    evaluator = InterpretedEvaluator(network)
    x, out = network.start_state.copy(), np.empty(network.size)
    count = max(20_000 // network.stages, 20)
    many(evaluator.tape, evaluator.work, x, out, 1)
    times = []
    for _ in range(REPEATS):
        began = time.process_time()
        many(evaluator.tape, evaluator.work, x, out, count)
        times.append((time.process_time() - began) / count)
    return 1e6 * float(np.median(times))


def figures() -> Iterator[Figure]:
    """One a horizon."""
    for stages in (9, 90, 900):
        plain = ann_dc.synthesize(ann_dc.plants.car(N=stages))
        linear = Linearisation(plain).at(plain.start_state)
        coarse = apply_gains(plain, closed_form(linear, MULTILEVEL_RULE))
        bare, full = microseconds(plain), microseconds(coarse)
        yield Figure(
            name=f"right-hand side of the car, N = {stages} ({plain.size} neurons)",
            value=f"{full:.2f} us",
            remark=f"{1e3 * full / stages:.0f} ns a cell; {bare:.2f} us diagonal",
        )


if __name__ == "__main__":
    raise SystemExit(show(figures()))
