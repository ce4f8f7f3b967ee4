"""Circuits: wall times of ngspice with its process, of netlists, predictions and Monte Carlo.

Medians of three; about two minutes in all.
"""

import time
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
from bench.figure import Figure, show

import ann_dc
from ann_dc.analysis.equilibria import equilibrium
from ann_dc.analysis.spectra import stability_limit
from ann_dc.backends.spice.backend import SpiceBackend, simulate
from ann_dc.backends.spice.netlist.deck import deck_of
from ann_dc.backends.spice.ngspice.runner import Ngspice
from ann_dc.fidelity.circuit_study import sample_decks
from ann_dc.fidelity.error_budget import sensitivity
from ann_dc.fidelity.prediction import predict
from ann_dc.hardware.emulation.building import emulate
from ann_dc.hardware.emulation.states import emulated_state
from ann_dc.hardware.parts import presets
from ann_dc.hardware.parts.levels import BEHAVIOURAL, TRANSISTOR, macro, switched_capacitor
from ann_dc.network.preconditioners.base import PreconditionerKind


def median(work: Callable[[], object], repeats: int = 3) -> float:
    """Seconds."""
    times = []
    for _ in range(repeats):
        began = time.perf_counter()
        work()
        times.append(time.perf_counter() - began)
    return float(np.median(times))


def network_of(problem) -> ann_dc.Network:
    """The network that is built."""
    return ann_dc.design(problem, preconditioner=PreconditionerKind.DIAGONAL).network


def simulated(network, level, repeats: int = 3) -> Figure:
    """Wall time of a level, from netlist to neurons."""
    backend = SpiceBackend(level=level, require_stable=False)
    circuit, probe = backend.prepare(network)
    seconds = median(lambda: simulate(backend, circuit, probe, {}), repeats)
    run = simulate(backend, circuit, probe, {}) if repeats > 1 else None
    remark = "" if run is None else (
        f"error {run.control_error:.1e}, mean square error {run.mean_square_error:.1e}, "
        f"settles in {1e6 * run.settling_time():.1f} us"
    )  # fmt: skip
    name = f"ngspice, car, {level.name}, N = {network.stages}"
    return Figure(name=name, value=f"{seconds:.2f} s", remark=remark)


def clocked(periods: int = 200) -> Figure:
    """Wall time of a short row of switched capacitors."""
    problem = ann_dc.plants.double_integrator(N=3, dt=0.5, q_0=(1, 0), q_d=(0, 0))
    network = network_of(problem)
    circuit, probe = SpiceBackend().prepare(network)
    step = 0.5 * stability_limit(network, probe.final)
    level = switched_capacitor(a0=1e7, step=step)
    circuit, probe = SpiceBackend(level=level).prepare(network)
    written = deck_of(circuit, level, duration=periods * step)
    seconds = median(lambda: Ngspice().run(written.text, end_time=written.end))
    name = f"ngspice, double integrator, {level.name}, N = 3"
    return Figure(name=name, value=f"{seconds:.2f} s", remark=f"{periods} clock periods")


def netlist(problem, stages: int) -> Figure:
    """Wall time of writing a deck."""
    circuit, _ = SpiceBackend(level=macro()).prepare(network_of(replace(problem, horizon=stages)))
    seconds = median(lambda: deck_of(circuit, macro(), duration=1.0))
    return Figure(name=f"netlist of the car, N = {stages}", value=f"{1e3 * seconds:.1f} ms")


def without_simulator(network) -> Iterator[Figure]:
    """Drawn decks, a prediction, and the sensitivity to every part."""
    level = presets.get("opa192_ad734")
    circuit, probe = SpiceBackend(level=level).prepare(network)
    seconds = median(lambda: sample_decks(circuit, level, probe, range(200)), 1)
    yield Figure(name="200 Monte Carlo netlists of the car", value=f"{seconds:.2f} s")
    seconds = median(lambda: predict(circuit, level, probe))
    yield Figure(name="prediction of the car on real parts", value=f"{seconds:.2f} s")
    emulation = emulate(circuit, level)
    x = equilibrium(emulation.network, emulated_state(emulation, probe.final))
    seconds = median(lambda: sensitivity(emulation, x))
    yield Figure(
        name="sensitivity of the car to every part",
        value=f"{1e3 * seconds:.1f} ms",
        remark=f"{len(emulation.slopes)} names",
    )


def figures() -> Iterator[Figure]:
    """Every figure."""
    problem = ann_dc.plants.car()
    car = network_of(problem)
    for level in (BEHAVIOURAL, macro(), macro(differential=True), TRANSISTOR):
        yield simulated(car, level)
    yield clocked()
    for stages in (9, 18, 36):
        yield netlist(problem, stages)
    yield from without_simulator(car)
    yield simulated(network_of(replace(problem, horizon=80)), macro(), 1)


if __name__ == "__main__":
    raise SystemExit(show(figures()))
