"""What every technology keeps to: a circuit in ngspice does what its emulation says.

The emulation of ideal op amps is the network itself, that of a clocked circuit the recurrent layer
with a step a period; all others have a network of their own. A technology that is added belongs
into this table.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest
import torch
from simulator import needs_ngspice

from ann_dc.backends.layers.recurrent_layer import RecurrentLayer
from ann_dc.backends.spice.backend import SpiceBackend, simulate
from ann_dc.backends.spice.circuit_run import CircuitRun
from ann_dc.backends.step_rules import FixedStep
from ann_dc.fidelity.circuit_instance import CircuitInstance
from ann_dc.hardware.circuit.deviations import Deviations, draw
from ann_dc.hardware.parts.datasheet import Tolerances
from ann_dc.hardware.parts.levels import (
    BEHAVIOURAL,
    TRANSISTOR,
    Level,
    macro,
    ota_c,
    switched_capacitor,
)
from ann_dc.network.cell import Cell, Connection, Neuron, Product
from ann_dc.network.network import Network

STEP = 0.1


@dataclass(frozen=True, kw_only=True, eq=False)
class Technology:
    """A level, and how far ngspice may be from the emulation, of the largest state."""

    level: Level
    close: float = 1e-4


TECHNOLOGIES = {
    "behavioural": Technology(level=BEHAVIOURAL),
    "macro": Technology(level=macro(a0=1e4)),
    "differential": Technology(level=macro(a0=1e4, differential=True)),
    "ota-c": Technology(level=ota_c(a0=1e4, linear_range=10.0)),
    "switched-capacitor": Technology(level=switched_capacitor(a0=1e6, step=STEP)),
    "transistor": Technology(level=TRANSISTOR, close=2e-3),  # of its multiplier
}


def pair() -> Network:
    """x' = y + 0.2 x y and y' = 0.5 - x - y: two stages, each on its own."""
    wires = (("y", "x", 1.0), ("xy", "x", 0.2), ("x", "y", -1.0), ("y", "y", -1.0))
    cell = Cell(
        neurons=(Neuron(name="x"), Neuron(name="y")),
        blocks=(Product(name="xy", a="x", b="y"),),
        connections=(
            *(Connection(source=s, target=t, weight=w) for s, t, w in wires),
            Connection(source="one", target="y", weight=0.5),
        ),
    )
    return Network(cell=cell, stages=2)


@cache
def prepared(name: str):
    return SpiceBackend(level=TECHNOLOGIES[name].level).prepare(pair())


@cache
def run_of(name: str, seed: int | None = None) -> CircuitRun:
    circuit, probe = prepared(name)
    backend = SpiceBackend(level=TECHNOLOGIES[name].level, require_stable=False)
    return simulate(backend, circuit, probe, errors_of(name, seed))


def errors_of(name: str, seed: int | None) -> Deviations:
    """Every kind of error that the cells of a technology have."""
    if seed is None:
        return {}
    sizes = {"resistor": 1e-2, "capacitor": 1e-2, "offset": 1e-3, "gain": 1e-2}
    missing = {kind.value for kind in TECHNOLOGIES[name].level.technology.without}
    tolerances = Tolerances(**{k: v for k, v in sizes.items() if k not in missing})
    return draw(prepared(name)[0].parameters, tolerances, seed)


def emulated(name: str, seed: int | None = None) -> np.ndarray:
    """States (4,) in which the emulation settles."""
    circuit, probe = prepared(name)
    instance = CircuitInstance(
        circuit=circuit,
        level=TECHNOLOGIES[name].level,
        probe=probe,
        deviations=errors_of(name, seed),
    )
    return instance.emulation.controls(instance.settled)


def largest_error(found: np.ndarray, wanted: np.ndarray) -> float:
    return float(np.abs(found - wanted).max() / np.abs(wanted).max())


CONTINUOUS = [name for name, t in TECHNOLOGIES.items() if not t.level.technology.clocked]


@needs_ngspice
@pytest.mark.parametrize("name", CONTINUOUS)
def test_ngspice_settles_where_the_emulation_does(name):
    found = run_of(name).trajectory.final
    assert largest_error(found, emulated(name)) < TECHNOLOGIES[name].close


@needs_ngspice
@pytest.mark.parametrize("name", [name for name in CONTINUOUS if name != "transistor"])
def test_parts_that_are_off_move_both_alike(name):
    moved = run_of(name, seed=1).trajectory.final - run_of(name).trajectory.final
    wanted = emulated(name, seed=1) - emulated(name)
    assert np.abs(wanted).max() > 1e-3
    assert largest_error(moved, wanted) < 2e-2


@needs_ngspice
def test_a_clocked_circuit_is_the_recurrent_layer():
    found = run_of("switched-capacitor").trajectory.states
    layer = RecurrentLayer(pair(), step=FixedStep(step=STEP))
    states = [torch.tensor(pair().start_state)[None]]
    with torch.no_grad():
        for _ in found[1:]:
            states.append(layer(states[-1], steps=1))
    assert largest_error(found, torch.cat(states).numpy()) < 1e-3


@needs_ngspice
@pytest.mark.parametrize("name", TECHNOLOGIES)
def test_every_technology_settles_at_the_networks_equilibrium(name):
    found = run_of(name)
    assert found.settled()
    np.testing.assert_allclose(found.trajectory.final, [0.5, 0.0, 0.5, 0.0], atol=1e-3)
