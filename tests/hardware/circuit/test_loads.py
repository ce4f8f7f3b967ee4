"""What op amps drive: sums of conductances, by hand."""

import numpy as np
import pytest

from ann_dc.hardware.circuit import Circuit, ProbeRun, circuit_of, loads, scale
from ann_dc.hardware.schematic import schematic_of
from ann_dc.network import Cell, Connection, Network, Neuron, Sum

WIRES = (
    ("x", "x", -1.0, 0),
    ("x", "y", 2.0, 0),  # one of the two needs the inverter
    ("y", "y", -1.0, 0),
    ("y", "sum", 1.0, -1),
    ("sum", "x", 0.5, 0),
)


def row() -> Circuit:
    """x and y in three cells, and a sum of the previous cell's y."""
    wires = [
        Connection(source=source, target=target, weight=weight, template=offset)
        for source, target, weight, offset in WIRES
    ]
    neurons = (Neuron(name="x"), Neuron(name="y"))
    cell = Cell(neurons=neurons, blocks=(Sum(name="sum"),), connections=tuple(wires))
    network = Network(cell=cell, stages=3)
    states = np.linspace(0, 1, 5)[:, None] * np.ones(network.size)
    probe = ProbeRun(states=states, times=np.arange(5.0), radius=4.0)
    return circuit_of(schematic_of(network), scale(network, probe))


def conductance(circuit: Circuit, source: str, target: str, stage: int) -> float:
    part = circuit.schematic.by_name[target]
    place = [wire.source for wire in part.wires].index(source)
    return 1 / circuit.resistors[target][place, stage]


def test_an_output_drives_the_resistors_that_read_it_and_those_of_its_inverter_another():
    circuit = row()
    driven, schematic = loads(circuit), circuit.schematic
    assert schematic.inverted == {name for name, inverter in driven if inverter}
    for stage in range(3):
        everything = conductance(circuit, "x", "x", stage) + conductance(circuit, "x", "y", stage)
        both = driven["x", False][stage] + driven.get(("x", True), np.zeros(3))[stage]
        extra = 2 / circuit.inverter if "x" in schematic.inverted else 0.0
        assert both == pytest.approx(everything + extra)


def test_a_neighbour_reads_too_and_the_last_cell_has_none():
    circuit = row()
    total = {name: np.zeros(3) for name in ("x", "y", "sum")}
    for (name, _), siemens in loads(circuit).items():
        total[name] = total[name] + siemens
    own = [conductance(circuit, "y", "y", stage) for stage in range(3)]
    read = [conductance(circuit, "y", "sum", 1), conductance(circuit, "y", "sum", 2), 0.0]
    extra = 2 / circuit.inverter if "y" in circuit.schematic.inverted else 0.0
    assert total["y"] == pytest.approx(np.add(own, read) + extra)


def test_an_adder_drives_its_own_feedback():
    circuit = row()
    wired = [conductance(circuit, "sum", "x", stage) for stage in range(3)]
    extra = 2 / circuit.inverter if "sum" in circuit.schematic.inverted else 0.0
    found = loads(circuit)
    both = found["sum", False] + found.get(("sum", True), np.zeros(3))
    assert both == pytest.approx(np.add(wired, 1 / circuit.feedback["sum"]) + extra)
