"""Circuits: wall times of ngspice with its process, of netlists, predictions and Monte Carlo.

Run it with ``python tests/bench/circuits.py`` (about two minutes). Medians of three.
"""

import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np

import ann_dc
from ann_dc.analysis.equilibria import equilibrium
from ann_dc.analysis.spectra import stability_limit
from ann_dc.backends.spice.backend import SpiceBackend, simulate
from ann_dc.backends.spice.netlist.deck import deck_of
from ann_dc.backends.spice.ngspice.runner import Ngspice
from ann_dc.fidelity.error_budget import sensitivity
from ann_dc.fidelity.monte_carlo import sample_decks
from ann_dc.fidelity.prediction import predict
from ann_dc.gain_design.recipe import WITHOUT_COORDINATORS
from ann_dc.hardware.emulation.emulation import emulate, emulated_state
from ann_dc.hardware.parts.levels import BEHAVIOURAL, TRANSISTOR, macro, switched_capacitor
from ann_dc.hardware.parts import presets


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
    return ann_dc.design(problem, recipe=WITHOUT_COORDINATORS).network


def simulated(network, level, repeats: int = 3) -> None:
    """Wall time of a level, from netlist to neurons."""
    backend = SpiceBackend(level=level, require_stable=False)
    circuit, probe = backend.prepare(network)
    seconds = median(lambda: simulate(backend, circuit, probe, {}), repeats)
    run = simulate(backend, circuit, probe, {}) if repeats > 1 else None
    meaning = "" if run is None else (
        f"error {run.control_error:.1e}, NMSE {run.mean_square_error:.1e}, "
        f"{1e6 * run.settling_time():.1f} us"
    )  # fmt: skip
    print(f"{level.name:20} N = {network.stages:3}  {seconds:6.2f} s  {meaning}")


def main() -> None:
    """Print every figure."""
    problem = ann_dc.plants.car()
    car = network_of(problem)
    for level in (BEHAVIOURAL, macro(), macro(differential=True), TRANSISTOR):
        simulated(car, level)
    lq = network_of(ann_dc.plants.double_integrator(N=3, dt=0.5, q_0=(1, 0), q_d=(0, 0)))
    circuit, probe = SpiceBackend().prepare(lq)
    step = 0.5 * stability_limit(lq, probe.final)
    level = switched_capacitor(a0=1e7, step=step)
    circuit, probe = SpiceBackend(level=level).prepare(lq)
    written = deck_of(circuit, level, duration=200 * step)
    seconds = median(lambda: Ngspice().run(written.text, end_time=written.end))
    print(f"{level.name:20} N =   3  {seconds:6.2f} s  200 periods of the double integrator")
    for stages in (9, 18, 36):
        network = network_of(replace(problem, horizon=stages))
        circuit, probe = SpiceBackend(level=macro()).prepare(network)
        seconds = median(lambda: deck_of(circuit, macro(), duration=1.0))  # noqa: B023
        print(f"netlist              N = {stages:3}  {1e3 * seconds:6.1f} ms")
    level = presets.get("opa192_ad734")
    circuit, probe = SpiceBackend(level=level).prepare(car)
    seconds = median(lambda: sample_decks(circuit, level, probe, range(200)), 1)
    print(f"200 drawn netlists   N =   9  {seconds:6.2f} s")
    print(f"prediction           N =   9  {median(lambda: predict(circuit, level, probe)):6.2f} s")
    emulation = emulate(circuit, level)
    x = equilibrium(emulation.network, emulated_state(emulation, probe.final))
    seconds = median(lambda: sensitivity(emulation, x))
    print(f"sensitivity          N =   9  {1e3 * seconds:6.1f} ms, {len(emulation.slopes)} names")
    simulated(network_of(replace(problem, horizon=80)), macro(), 1)


if __name__ == "__main__":
    main()
