"""Circuits of generic transistors: emulated error, temperature and supplies, mismatch and area.

Nothing is fitted to a network: the emulation has the law of one multiplier, found by sweeps of it.
Plants and corners run in ngspice; where its finer steps take more than two minutes, settling times
are those of coarser ones. Mismatch is emulated. Seconds are those of one run.
"""

import time
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from bench.figure import Figure, show
from bench.preset_circuits import PLANTS, network_of
from by_hand import BY_HAND

from ann_dc.backends.spice.backend import SpiceBackend, simulate
from ann_dc.errors import AnnDcError
from ann_dc.fidelity.boards.corners import corners
from ann_dc.fidelity.circuit_instance import CircuitInstance
from ann_dc.fidelity.circuit_study import instances, settled_error
from ann_dc.fidelity.prediction import predict
from ann_dc.hardware.circuit.cost import cost_of
from ann_dc.hardware.circuit.loads import load_power
from ann_dc.hardware.parts.datasheet import Kind
from ann_dc.hardware.parts.levels import TRANSISTOR, transistor

OFF = 0.1
"""By how much the emulated error may be off that of ngspice."""

WORST = 2e-2
"""Error that no corner may exceed."""

ENDS = {"temperatures": (-40.0, 125.0), "supplies": (0.9, 1.1), "processes": ("tt",)}

AREAS = (1, 4, 16, 36, 64)
"""Of the gates that match, over the smallest."""

DRAWN = 20


def backend_of(area: float = 1) -> SpiceBackend:
    """Return what makes circuits of transistors with matched gates of an area."""
    return SpiceBackend(level=TRANSISTOR if area == 1 else transistor(area=area))


def made(plant: str) -> Figure:
    """One plant, with the parts of its drawings."""
    backend, name = backend_of(), f"transistors, {plant}: error"
    try:
        circuit, probe = backend.prepare(network_of(plant))
        said, began = predict(circuit, backend.level, probe), time.perf_counter()
        run = simulate(backend, circuit, probe)
    except AnnDcError as refusal:
        return Figure(name=name, value="refused", remark=str(refusal))
    seconds = time.perf_counter() - began
    off = said.control_error / run.control_error - 1
    deck = backend.deck(circuit, probe, {})
    loads = load_power(circuit, backend.level, probe.final)
    cost = cost_of(deck.parts, backend.level.datasheet, run.settling_time(), loads)
    return Figure(
        name=name,
        value=f"{run.control_error:.2e}",
        remark=f"matched parts; emulated {said.control_error:.2e} ({off:+.1%}); settled after "
        f"{1e6 * run.settling_time():.4g} us, emulated {1e6 * said.settling_time:.4g}; "
        f"{1e6 * cost.energy:.2g} uJ a solve; {seconds:.0f} s",
        good=run.settled() and abs(off) < OFF,
    )


def at_the_ends(plant: str) -> Figure:
    """The ends of temperature and supplies."""
    backend = backend_of()
    circuit, probe = backend.prepare(network_of(plant))
    found = corners(backend, circuit, probe, **ENDS)
    errors = [corner.control_error for corner in found]
    times = [1e6 * corner.settling_time for corner in found]
    return Figure(
        name=f"transistors, {plant}: error from -40 to 125 C, supplies 10 % up and down",
        value=f"{max(errors):.2e}",
        remark=f"at most; {min(errors):.2e} at least; settled after {min(times):.4g} to "
        f"{max(times):.4g} us",
        good=all(corner.stable and corner.control_error < WORST for corner in found),
    )


def drawn(plant: str, area: float, *, gates: bool = True) -> Figure:
    """Mismatch of gates by 10 mV um, with resistors and gains that match or do not."""
    backend = backend_of(area)
    level, sizes = backend.level, backend.level.tolerances
    if gates:
        sizes = sizes.without((Kind.RESISTOR, Kind.CAPACITOR, Kind.GAIN))
    level = replace(level, datasheet=replace(level.datasheet, tolerances=sizes))
    backend = replace(backend, level=level)
    circuit, probe = backend.prepare(network_of(plant))
    nominal = CircuitInstance(circuit=circuit, level=backend.level, probe=probe)
    errors = np.array([settled_error(each) for each in instances(nominal, range(DRAWN))])
    settling = int(np.isfinite(errors).sum())
    said = predict(circuit, backend.level, probe)
    return Figure(
        name=f"transistors, {plant}: {DRAWN} with {sizes}, {area} times the area",
        value=f"{np.nanmedian(errors):.2%}",
        remark=f"median; 90 % below {np.nanquantile(errors, 0.9):.2%}; {settling} settle; "
        f"without {said.control_error:.2%}, after {1e6 * said.settling_time:.4g} us",
        good=settling == DRAWN,
    )


def figures() -> Iterator[Figure]:
    """Every figure."""
    for plant in (*PLANTS, *BY_HAND):
        yield made(plant)
    yield at_the_ends("car")
    for area in AREAS:
        yield drawn("car", area)
    yield drawn("car", 36, gates=False)


if __name__ == "__main__":
    raise SystemExit(show(figures()))
