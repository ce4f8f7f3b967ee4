"""Circuits of SKY130 devices: corners, mismatch and area of two plants.

The models are those of the PDK (extra ``sky130``), simulated by ngspice. Emulation knows neither
the corners nor the PDK's mismatch. Seconds are those of one run, at the machine's load.
"""

import time
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from bench.figure import Figure, show

import ann_dc
from ann_dc.backends.spice.backend import SpiceBackend
from ann_dc.backends.spice.circuit_run import CircuitRun
from ann_dc.backends.spice.pdk.area import area_of
from ann_dc.fidelity.prediction import predict
from ann_dc.hardware.circuit.cost import cost_of
from ann_dc.hardware.circuit.loads import load_power
from ann_dc.hardware.parts.conditions import CORNERS, Conditions
from ann_dc.hardware.parts.foundry import SKY130
from ann_dc.network.preconditioners.base import PreconditionerKind

ENDS = ((27.0, 1.0), (-40.0, 0.9), (125.0, 0.9), (-40.0, 1.1), (125.0, 1.1))
"""Temperatures in degrees Celsius and supplies over nominal."""

DRAWN = 20
"""Circuits with mismatch."""

OF_THE_CAR = ("tt", "ss", "ff")
"""Its corners: three minutes each."""


class Chip:
    """A plant's circuit, simulated at conditions and with mismatch."""

    def __init__(self, name: str, stages: int) -> None:
        self.name = f"{name}, N = {stages}"
        problem = getattr(ann_dc.plants, name)(N=stages)
        network = ann_dc.design(problem, preconditioner=PreconditionerKind.DIAGONAL).network
        self.backend = SpiceBackend(level=SKY130)
        self.circuit, self.probe = self.backend.prepare(network)

    def run(self, at: Conditions, seed: int | None = None) -> tuple[CircuitRun, float]:
        """A run and its seconds."""
        backend = replace(self.backend, level=SKY130.at(at), seed=seed)
        deck = backend.deck(self.circuit, self.probe, backend.deviations(self.circuit))
        began = time.perf_counter()
        run = backend.measure(self.circuit, deck, self.probe)
        return run, time.perf_counter() - began

    def size(self) -> Figure:
        """What it takes."""
        reported = predict(self.circuit, SKY130, self.probe)
        deck = self.backend.deck(self.circuit, self.probe, {})
        loads = load_power(self.circuit, SKY130, self.probe.final)
        cost = cost_of(deck.parts, SKY130.datasheet, reported.settling_time, loads)
        area = area_of(self.circuit, deck.parts, deck.library)
        return Figure(
            name=f"{self.name}: area and power",
            value=f"{area.total / 1e6:.2f} mm2, {cost.power:.2g} W",
            remark=f"emulated {reported.control_error:.2e}, {1e6 * reported.settling_time:.2f} us; "
            + ", ".join(f"{count} {part}" for part, count in deck.parts.items()),
        )

    def at(self, at: Conditions) -> Figure:
        """One run at conditions."""
        run, seconds = self.run(at)
        return Figure(
            name=f"{self.name}: {at.process}, {at.temperature:g} C, {at.supply:g} of the supplies",
            value=f"{run.control_error:.2e}",
            remark=f"settled after {1e6 * run.settling_time():.2f} us, in {seconds:.0f} s",
            good=run.settled(),
        )

    def drawn(self, count: int) -> Figure:
        """Circuits with the PDK's mismatch, at tt."""
        runs = [self.run(Conditions(), seed)[0] for seed in range(count)]
        errors = np.array([run.control_error for run in runs])
        settling = sum(run.settled() for run in runs)
        return Figure(
            name=f"{self.name}: {count} with mismatch",
            value=f"{np.median(errors):.2e}",
            remark=f"median; {errors.min():.2e} to {errors.max():.2e}; {settling} settle",
            good=settling == count,
        )


def figures() -> Iterator[Figure]:
    """Every figure."""
    small = Chip("double_integrator", 3)
    yield small.size()
    for process in CORNERS:
        for celsius, supply in ENDS:
            yield small.at(Conditions(temperature=celsius, supply=supply, process=process))
    yield small.drawn(DRAWN)
    car = Chip("car", 9)
    yield car.size()
    for process in OF_THE_CAR:
        yield car.at(Conditions(process=process))


if __name__ == "__main__":
    raise SystemExit(show(figures()))
