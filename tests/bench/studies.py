"""Studies: many chips, circuits and targets of the paper's car, and settling times predicted.

Every figure is CPU time over the cores that it keeps busy: what one waits on a machine that does
nothing else. Chips have errors of 1 % on every weight and time constant, circuits those of their
parts. Settling is predicted from the modes at the settled point, for every plant of the suite up to
`LARGEST` neurons: from other targets, and of chips.
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import shutil
import time
import tracemalloc
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from bench.figure import Figure, show
from problems import SUITE

import ann_dc
from ann_dc.analysis.linearisation import Linearisation
from ann_dc.analysis.predicted_settling import predicted_settling
from ann_dc.backends.decay import decay_rate
from ann_dc.fidelity.circuit_study import predicted_errors
from ann_dc.gain_design.gain_rule import GainRule, closed_form
from ann_dc.gain_design.gains import apply_gains
from ann_dc.hardware.nonidealities.numbers import drawn_numbers, mismatch
from ann_dc.hardware.parts.levels import macro
from ann_dc.network.inputs import input_batch, moved_starts

CHIPS, TARGETS, CIRCUITS = 10_000, 100_000, 1000
CHIPS_BAR, TARGETS_BAR, CIRCUITS_BAR = 60.0, 60.0, 300.0
"""Seconds."""
ALONE = 5
"""Chips that SciPy integrates one by one."""
LARGEST, ROWS = 600, 60
"""Neurons of a plant whose settling is predicted; its targets, and its chips."""
MEDIAN_BAR, MOST_BAR = 0.05, 0.20
"""Relative errors of predictions: the median, and of all but a twentieth."""
STAGES = (9, 90, 900, 10_000)
TRAVELLED = 20.0
"""Fastest time constants of a run over long rows."""


@dataclass(frozen=True)
class Taken:
    """What a call gave, and its CPU and wall seconds."""

    found: Any
    cpu: float
    wall: float

    @property
    def busy(self) -> float:
        """Seconds on cores of its own; threads share the work evenly."""
        return self.cpu / cores()


def cores() -> int:
    return len(os.sched_getaffinity(0))


def timed(call: Callable[[], Any]) -> Taken:
    cpu, wall = time.process_time(), time.perf_counter()
    found = call()
    return Taken(found, time.process_time() - cpu, time.perf_counter() - wall)


@cache
def car(*kinds: ann_dc.PreconditionerKind) -> ann_dc.Network:
    problem = ann_dc.plants.car()
    return (
        ann_dc.design(problem, preconditioner=kinds) if kinds else ann_dc.design(problem)
    ).network


def run_chips(count: int) -> ann_dc.backends.BatchRun:
    numbers = drawn_numbers(car(), range(count), weights=0.01, time_constants=0.01)
    return ann_dc.OdeBackend().run_batch(car(), {}, numbers=numbers)


def chips() -> Iterator[Figure]:
    """In a batch, beside SciPy one by one, and ngspice."""
    run_chips(64)
    taken = timed(lambda: run_chips(CHIPS))
    yield Figure(
        name=f"{CHIPS} chips of the car, drawn and settled, {cores()} cores",
        value=f"{taken.busy:.1f} s",
        remark=f"{CHIPS / taken.busy:.0f} a second, {taken.found.settled.sum()} settled; "
        f"wall {taken.wall:.1f} s; bar {CHIPS_BAR:.0f} s",
        good=taken.busy <= CHIPS_BAR,
    )
    backend = ann_dc.OdeBackend(method=ann_dc.ode.DOP853, verify=False)
    each = [taken.found.network_of(sample) for sample in range(ALONE)]
    alone = timed(lambda: [backend.run(network) for network in each])
    apart = max(
        abs(run.settling_time / taken.found.settling_times[sample] - 1)
        for sample, run in enumerate(alone.found)
    )
    yield Figure(
        name="the same chips one by one, OdeBackend with SciPy's DOP853, one core",
        value=f"{ALONE / alone.cpu:.1f} a second",
        remark=f"settling times within {apart:.1e} of those of the batch",
    )
    if shutil.which("ngspice"):
        network = mismatch(car(ann_dc.PreconditionerKind.DIAGONAL), 0.01, seed=0)
        wall = timed(lambda: ann_dc.SpiceBackend().run(network)).wall
        yield Figure(
            name="one chip, diagonal, in ngspice, behavioural, prepared and run",
            value=f"{1 / wall:.2f} a second",
            remark=f"wall {wall:.1f} s",
        )


def circuits() -> Iterator[Figure]:
    """Settled points and eigenvalues."""
    level = macro()
    backend = ann_dc.SpiceBackend(level=level)
    circuit, probe = backend.prepare(car(ann_dc.PreconditionerKind.DIAGONAL))
    taken = timed(lambda: predicted_errors(circuit, level, probe, range(CIRCUITS)))
    good = np.isfinite(taken.found)
    yield Figure(
        name=f"{CIRCUITS} drawn circuits of the car, emulated: settled point, eigenvalues",
        value=f"{taken.cpu:.0f} s",
        remark=f"one core, {CIRCUITS / taken.cpu:.1f} a second; {good.sum()} settle, control error "
        f"{np.median(taken.found[good]):.3f} (median); bar {CIRCUITS_BAR:.0f} s",
        good=taken.cpu <= CIRCUITS_BAR,
    )


def targets() -> Iterator[Figure]:
    """A batch of inputs."""
    rng = np.random.default_rng(0)
    inputs = {name: rng.uniform(4.5, 5.5, TARGETS) for name in ("q_d.x", "q_d.y")}
    taken = timed(lambda: ann_dc.OdeBackend().run_batch(car(), inputs))
    yield Figure(
        name=f"{TARGETS} targets of the car, {cores()} cores",
        value=f"{taken.busy:.1f} s",
        remark=f"{TARGETS / taken.busy:.0f} a second, {taken.found.settled.sum()} settled; "
        f"wall {taken.wall:.1f} s; bar {TARGETS_BAR:.0f} s",
        good=taken.busy <= TARGETS_BAR,
    )


# ---- predictions -------------------------------------------------------------------------------


def others(network: ann_dc.Network, count: int) -> dict[str, np.ndarray]:
    """Targets around the network's, by a tenth of every component's scale."""
    rng = np.random.default_rng(0)
    return {
        name: values[0] + network.input_scale(name).factor * rng.uniform(-0.1, 0.1, count)
        for name, values in network.inputs.items()
        if name.startswith("q_d.")
    }


def predictions(network: ann_dc.Network) -> np.ndarray:
    """(rows, 2): predicted over measured settling time, less one: linear, and as it is."""
    backend, inputs = ann_dc.OdeBackend(), others(network, ROWS)
    chips = drawn_numbers(network, range(ROWS), weights=0.005, time_constants=0.02)
    straight = np.repeat(network.start_state[None], ROWS, axis=0)
    moved = moved_starts(network, input_batch(network, inputs))
    rows = []
    for batch, starts in (
        (backend.run_batch(network, inputs), moved),
        (backend.run_batch(network, {}, numbers=chips), straight),
    ):
        for sample in np.flatnonzero(batch.settled):
            own, end = batch.network_of(sample), batch.states[sample]
            found = [predicted_settling(own, end, starts[sample], linear=s) for s in (True, False)]
            rows.append(np.array(found) / batch.settling_times[sample] - 1)
    return np.array(rows).reshape(-1, 2)


def predicted() -> Iterator[Figure]:
    """One a plant, and one of all."""
    every = []
    for name, entry in SUITE.items():
        network = ann_dc.synthesize(entry.problem)
        if network.size > LARGEST:
            continue
        network = ann_dc.design(network).network
        every.append(predictions(network))
        trajectory = ann_dc.OdeBackend(verify=False).run(network).trajectory
        rate = -ann_dc.spectrum(network, trajectory.final).abscissa
        yield _of_errors(
            f"{name} ({network.size} neurons): settling predicted",
            every[-1],
            f"; rate of decay measured over the spectrum's {decay_rate(trajectory) / rate:.2f}",
        )
    errors = np.concatenate(every)
    middle, most = np.nanmedian(np.abs(errors[:, 1])), _most(errors[:, 1])
    yield _of_errors(
        f"all {len(errors)} settling times predicted",
        errors,
        f"; bars {MEDIAN_BAR:.0%} and {MOST_BAR:.0%}",
        good=middle <= MEDIAN_BAR and most <= MOST_BAR,
    )
    began = [timed(lambda: predicted_settling(car(), end(), car().start_state)) for _ in range(9)]
    yield Figure(
        name="one prediction of the car (150 neurons)",
        value=f"{1e3 * min(taken.cpu for taken in began):.0f} ms",
        good=min(taken.cpu for taken in began) <= 0.03,
        remark="bar 30 ms",
    )


@cache
def end() -> np.ndarray:
    """Where the car settles."""
    return ann_dc.OdeBackend(verify=False).run(car()).trajectory.final


def _most(errors: np.ndarray) -> float:
    return float(np.nanpercentile(np.abs(errors), 95))


def _of_errors(name: str, errors: np.ndarray, remark: str, *, good: bool = True) -> Figure:
    linear, bent = errors.T
    return Figure(
        name=name,
        value=f"within {np.nanmedian(np.abs(bent)):.1%}, {_most(bent):.1%}",
        remark=f"median and 95th percentile of {len(errors)}; of the linear flow alone "
        f"{np.nanmedian(np.abs(linear)):.1%}, {_most(linear):.1%}{remark}",
        good=good,
    )


# ---- long rows ---------------------------------------------------------------------------------


def long_rows() -> Iterator[Figure]:
    """Time and memory of a run, a unit of network time; exponents over the number of stages."""
    times, memory = [], []
    for stages in STAGES:
        network = ann_dc.synthesize(ann_dc.plants.double_integrator(N=stages))
        linear = Linearisation(network).at(network.start_state)
        gain_rule = GainRule(kind=ann_dc.PreconditionerKind.DIAGONAL)
        network = apply_gains(network, closed_form(linear, gain_rule))
        backend = ann_dc.OdeBackend(verify=False, limit=TRAVELLED)
        ended = backend.run(network).status.time
        times.append(min(timed(lambda: backend.run(network)).cpu for _ in range(5)) / ended)  # noqa: B023
        tracemalloc.start()
        backend.run(network)
        memory.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    for name, found, unit, scale in (
        ("run time a unit of network time", times, "ms", 1e3),
        ("memory of a run", memory, "MB", 1e-6),
    ):
        exponent = np.polyfit(np.log(STAGES[1:]), np.log(found[1:]), 1)[0]
        yield Figure(
            name=f"double integrator, N = {', '.join(map(str, STAGES))}: {name}",
            value=", ".join(f"{scale * value:.3g}" for value in found) + f" {unit}",
            remark=f"exponent {exponent:.2f} from N = {STAGES[1]} on",
            good=exponent <= 1.1,
        )


def figures() -> Iterator[Figure]:
    """Chips, circuits, targets, predictions, long rows."""
    for part in (chips, circuits, targets, predicted, long_rows):
        yield from part()


if __name__ == "__main__":
    raise SystemExit(show(figures()))
