"""What op amps drive, against the netlist that ngspice reads."""

import re
from collections import defaultdict

import numpy as np
import pytest
from wired import prepared

from ann_dc.backends.spice.backend import SpiceBackend
from ann_dc.backends.spice.netlist.deck import deck_of
from ann_dc.hardware.circuit.loads import heaviest, load_power, loads_of, moving_load
from ann_dc.hardware.parts.levels import macro
from ann_dc.network.cell import Cell, Connection, Limiter, Neuron
from ann_dc.network.network import Network


def driven(deck) -> dict[str, float]:
    """Siemens at every top-level node: resistors of the cells' cards, inverters and adders."""
    text = deck.text[deck.text.index("* ---- cells") :].replace("\n+ ", " ")
    cells = {}
    for body in re.findall(r"^\.subckt (cell_\d+) .*?^\.ends", text, re.M | re.S):
        start = text.index(f".subckt {body} ")
        cells[body] = text[start : text.index(".ends", start)].splitlines()
    found = defaultdict(float)
    for card in re.findall(r"^X_cell_\d+ .*$", text, re.M):
        words = card.split()
        name = next(word for word in words if word in cells)
        head, _, defaults = cells[name][0].partition(" params: ")
        values = dict(pair.split("=") for pair in defaults.split())
        values |= dict(word.split("=") for word in words if "=" in word)
        ports = dict(zip(head.split()[2:], words[1 : words.index(name)]))
        for line in cells[name][1:]:
            _drive(line.split(), ports, values, found)
    return found


def _drive(words, ports, values, found) -> None:
    def ohms(text: str) -> float:
        return float(values.get(text.strip("{}"), text.strip("{}")))

    if words[0].startswith("R_"):
        found[ports[words[1]]] += 1 / ohms(words[3])
    elif words[0].startswith("X") and "inv" in words:
        own, other = (ports[word] for word in words[1:3])
        r = float(next(w for w in words if w.startswith("r=")).removeprefix("r="))
        found[own] += 1 / r
        found[other] += 1 / r
    elif words[0].startswith("X") and "sum" in words:
        rf = next(w for w in words if w.startswith("rf=")).removeprefix("rf=")
        found[ports[words[2]]] += 1 / ohms(rf)


@pytest.mark.parametrize("differential", [False, True])
def test_loads_are_those_of_the_netlist(differential):
    circuit, _ = prepared(differential)
    if differential:
        siemens = {part for part, inverter in loads_of(circuit) if inverter}
        assert not siemens
        return
    wanted = driven(deck_of(circuit, macro(), duration=1.0))
    compared = 0
    for (name, inverter), loads in loads_of(circuit).items():
        for stage, siemens in enumerate(loads):
            node = f"{circuit.alias[name]}__{stage}" + ("__n" if inverter else "")
            if circuit.schematic.alive(name, stage):
                assert siemens == pytest.approx(wanted.get(node, 0.0), rel=1e-6), node
                compared += 1
    assert compared > 150


def test_the_heaviest_load_is_one_over_the_resistors():
    circuit, _ = prepared(False)
    once, half = heaviest(circuit), heaviest(circuit.slower(2.0))
    assert once == half  # a slower circuit has the same resistors
    name = once.part
    volts = circuit.scaling.volts(name, circuit.scaling.peaks[name].value)
    moving = 0.0 if once.inverter else moving_load(circuit, name)
    siemens = loads_of(circuit)[name, once.inverter][once.stage] + moving
    assert once.amperes == pytest.approx(volts * siemens)
    assert str(once).endswith(f"{name} of cell {once.stage}")


def test_a_circuit_that_is_slower_has_larger_capacitors_and_nothing_else():
    circuit, _ = prepared(False)
    slow = circuit.slower(3.0)
    assert slow.scaling.bandwidth_margin == 3 * circuit.scaling.bandwidth_margin
    assert slow.scaling.time == 3 * circuit.scaling.time
    for name, farads in circuit.capacitors.items():
        np.testing.assert_array_equal(slow.capacitors[name], 3 * farads)
    assert slow.resistors is circuit.resistors


@pytest.mark.parametrize(("low", "high"), [(-1.5, 1.5), (0.0, 1.5), (-np.inf, 1.5)])
def test_clamps_drive_what_lies_before_their_references(low, high):
    """20e9 / GBW ohm between output and rail, from the supply; x rests at 1 of 1.8 a volt."""

    def watts(limiter: Limiter) -> float:
        ends = (("x", "x", -1.0), ("one", "x", 1.0))
        wires = tuple(Connection(source=s, target=t, weight=w) for s, t, w in ends)
        cell = Cell(neurons=(Neuron(name="x", limiter=limiter),), connections=wires)
        backend = SpiceBackend(level=macro(output_swing=13.0), intervals={"x": (-1.5, 1.5)})
        circuit, probe = backend.prepare(Network(cell=cell, stages=1))
        return load_power(circuit, backend.level, probe.final)

    volts = sum(abs(rail - 1.0) / 1.8 for rail in (low, high) if np.isfinite(rail))
    added = watts(Limiter(low=low, high=high)) - watts(Limiter())
    assert added == pytest.approx(13 * volts / 2000, rel=1e-6)
