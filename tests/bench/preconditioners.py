"""Cost of the preconditioners by kind and number of stages.

The car at N = 9, 90, 900, 9000 (same dt): nanoseconds a cell of applying a preconditioner by
itself, in compiled loops, in torch and in NumPy, and the compiled right-hand side beside the one
with time constants alone, all at the same states; then the right-hand side in generated code, all
kinds in turns. The bars: the work grows as N, so a cell costs at 9000 no more than twice what it
does at 90 (the caches are smaller than the row), and the grid makes the right-hand side no more
than three times as slow, in loops and in generated code. The smallest of a few repeats counts, in
CPU time.
"""

import time
from collections.abc import Callable, Iterator

import numba as nb
import numpy as np
import torch
from bench.figure import Figure, show
from bench.in_turns import Contestant, in_turns
from bench.kernel import many
from random_preconditioners import STIFFNESSES, with_stiffness

import ann_dc
from ann_dc.analysis.linearisation import Linearisation
from ann_dc.backends.layers.cell_layer import CellLayer
from ann_dc.evaluation import loops
from ann_dc.evaluation.calls import call
from ann_dc.evaluation.codegen.lanes import Lanes
from ann_dc.evaluation.codegen.plan import Axis
from ann_dc.evaluation.interpreted import InterpretedEvaluator
from ann_dc.evaluation.reference import evaluator
from ann_dc.gain_design.gain_rule import GainRule, closed_form
from ann_dc.gain_design.gains import apply_gains
from ann_dc.network.preconditioners.base import PreconditionerKind

HORIZONS = (9, 90, 900, 9000)
KINDS = (
    PreconditionerKind.DIAGONAL,
    PreconditionerKind.MULTILEVEL,
    PreconditionerKind.COUPLED_MULTILEVEL,
    PreconditionerKind.RESISTIVE_GRID,
    PreconditionerKind.CYCLIC_REDUCTION,
)
REPEATS = 9
ROUNDS = 60
MOST_OF_GRID = 3.0
MOST_GROWTH = 2.0
MOST_SECONDS = 1.0


@nb.njit
def many_moves(tape, work, count):
    """``count`` products of the preconditioner in a row."""
    for _ in range(count):
        loops.derivative(tape, work)
        work.drives[0, 0] += 1e-12 * work.derivatives[0, 0]  # so that no call can be dropped


def seconds_of(call: Callable[[int], object], count: int) -> float:
    """Least CPU time of one of ``count`` calls, over the repeats."""
    call(1)
    times = []
    for _ in range(REPEATS):
        began = time.process_time()
        call(count)
        times.append(time.process_time() - began)
    return min(times) / count


def wired(network: ann_dc.Network, kind: PreconditionerKind) -> ann_dc.Network:
    """With a preconditioner of a kind and its time constants, in closed form at the start."""
    if kind in STIFFNESSES:
        return with_stiffness(network, kind)
    linear = Linearisation(network).at(network.start_state)
    return apply_gains(network, closed_form(linear, GainRule(kind=kind)))


def compiled_times(network: ann_dc.Network) -> tuple[float, float]:
    """Seconds of (a right-hand side, a product of the preconditioner)."""
    compiled = InterpretedEvaluator(network)
    x, out = network.start_state.copy(), np.empty(network.size)
    count = calls_of(network)
    whole = seconds_of(lambda n: many(compiled.tape, compiled.work, x, out, n), count)
    part = seconds_of(lambda n: many_moves(compiled.tape, compiled.work, n), count)
    return whole, part


@nb.njit
def many_in_code(rhs, table, x, out, count):
    """``count`` right-hand sides of generated code in a row."""
    for _ in range(count):
        call(rhs, (table, x.ctypes.data, out.ctypes.data), ())


def in_code(network: ann_dc.Network, kind: PreconditionerKind) -> Contestant:
    """Right-hand sides of generated code; as many cells, whatever the horizon."""
    lanes = Lanes(evaluator(network).tape, Axis.STAGES)
    x, count = lanes.state(network.start_state), calls_of(network)

    def run() -> None:
        entry = lanes.entry
        many_in_code(entry.rhs, entry.table.ctypes.data, x, lanes.derivatives, count)

    return Contestant(name=kind.value, call=run)


def calls_of(network: ann_dc.Network) -> int:
    """How many are timed at once."""
    return max(20_000 // network.stages, 5)


def torch_time(network: ann_dc.Network) -> float:
    """Seconds of a product in torch, of one sample."""
    layer = CellLayer(network)
    constants, layout = layer.constants(), layer.layout
    generator = torch.Generator().manual_seed(0)
    drives = torch.randn(*layout.live.shape, dtype=torch.float64, generator=generator)
    drives = drives * layout.live
    with torch.inference_mode():
        return seconds_of(
            lambda n: [layout.preconditioner(constants, drives) for _ in range(n)],
            max(2000 // network.stages, 3),
        )


def reference_time(network: ann_dc.Network) -> float:
    """Seconds of a product in NumPy."""
    drive, ours = np.random.default_rng(0).standard_normal(network.size), evaluator(network)
    return seconds_of(
        lambda n: [ours.derivative(drive) for _ in range(n)], max(1000 // network.stages, 3)
    )


def figures() -> Iterator[Figure]:
    """One a kind and horizon, and what it takes to make a long grid and a long tree."""
    a_cell: dict[tuple[PreconditionerKind, int], float] = {}
    for stages in HORIZONS:
        plain = ann_dc.synthesize(ann_dc.plants.car(N=stages))
        bare, networks = 0.0, {kind: wired(plain, kind) for kind in KINDS}
        for kind, network in networks.items():
            whole, part = compiled_times(network)
            bare = whole if kind is PreconditionerKind.DIAGONAL else bare
            a_cell[kind, stages] = part / stages
            grown = part / stages / a_cell.get((kind, 90), np.inf)
            slow = kind in STIFFNESSES and whole > MOST_OF_GRID * bare
            yield Figure(
                name=f"N = {stages}, {kind.value}",
                value=f"{1e9 * part / stages:.0f} ns a cell",
                remark=f"torch {1e9 * torch_time(network) / stages:.0f}, NumPy "
                f"{1e9 * reference_time(network) / stages:.0f} ns a cell; right-hand side "
                f"{1e6 * whole:.2f} us, {whole / bare:.2f} of that with the diagonal one",
                good=not slow and grown <= MOST_GROWTH,
            )
        yield from _in_code(networks)
    yield from _made_once(plain)


def _in_code(networks: dict[PreconditionerKind, ann_dc.Network]) -> Iterator[Figure]:
    """One a kind, at one horizon."""
    contestants = {kind: in_code(network, kind) for kind, network in networks.items()}
    in_turns([*contestants.values()], rounds=ROUNDS)
    plain = networks[PreconditionerKind.DIAGONAL]
    bare = min(contestants[PreconditionerKind.DIAGONAL].cpu)
    for kind, one in contestants.items():
        ratio, seconds = min(one.cpu) / bare, min(one.cpu) / calls_of(plain)
        yield Figure(
            name=f"N = {plain.stages}, {kind.value}: generated code",
            value=f"{1e9 * seconds / plain.stages:.0f} ns a cell",
            remark=f"right-hand side {1e6 * seconds:.2f} us, {ratio:.2f} of that with time "
            "constants alone",
            good=kind not in STIFFNESSES or ratio <= MOST_OF_GRID,
        )


def _made_once(network: ann_dc.Network) -> Iterator[Figure]:
    """What is done once a design: check a stiffness, put it on the tape, list its wires."""
    for kind in STIFFNESSES:
        given = with_stiffness(network, kind)
        preconditioner, row = given.preconditioner, given.row
        steps = {
            "refuse or accept it": lambda: preconditioner.check(row),  # noqa: B023
            "evaluator": lambda: evaluator(given),  # noqa: B023
            "wires": lambda: preconditioner.wires(row),  # noqa: B023
            "torch layer": lambda: CellLayer(given),  # noqa: B023
        }
        for name, step in steps.items():
            began = time.process_time()
            step()
            seconds = time.process_time() - began
            yield Figure(
                name=f"N = {network.stages}, {kind.value}: {name}",
                value=f"{1e3 * seconds:.0f} ms",
                remark="once a design",
                good=seconds <= MOST_SECONDS,
            )


if __name__ == "__main__":
    raise SystemExit(show(figures()))
