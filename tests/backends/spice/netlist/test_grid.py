"""A grid in the netlist: every resistor drawn, node capacitance, nothing that an op amp inverts."""

from functools import cache

import numpy as np
import pytest
from counting import counted
from metric_networks import with_metric
from simulator import needs_ngspice

from ann_dc.backends.spice import SpiceBackend, simulate
from ann_dc.backends.spice.netlist import deck_of
from ann_dc.fidelity import predict
from ann_dc.hardware.circuit import NEGATIVE, RESISTOR, to_ground
from ann_dc.hardware.parts import macro
from ann_dc.hardware.schematic import GridNode
from ann_dc.network.metrics import Kind


@cache
def prepared(name: str, horizon: int | None, margin: float = 60.0):
    backend = SpiceBackend(level=macro(), margin=margin, node_lag=2e-3)
    return backend, *backend.prepare(with_metric(name, Kind.GRID, horizon))


def test_parts_are_those_of_the_netlist():
    _, circuit, _ = prepared("car", 5)
    deck = deck_of(circuit, macro(), duration=1.0)
    ours = dict(deck.parts)
    ours[RESISTOR] += ours.pop(NEGATIVE, 0)
    assert counted(deck.text) == ours


def test_conductances_add_up_to_those_of_the_nodes():
    """All that ends at a node, and what goes to ground, is its conductance; lag is C over that."""
    _, circuit, _ = prepared("car", 5)
    for part in circuit.schematic.parts:
        if isinstance(part, GridNode):
            ohms, total = circuit.resistors[part.name], circuit.conductances[part.name]
            rest = to_ground(total, ohms)
            np.testing.assert_allclose((1 / ohms).sum(axis=0) + rest, total, rtol=1e-9)


def test_a_resistor_between_two_nodes_is_the_same_seen_from_either():
    _, circuit, _ = prepared("car", 5)
    seen = {}
    for part in circuit.schematic.parts:
        if isinstance(part, GridNode):
            for wire, ohms in zip(part.wires, circuit.resistors[part.name]):
                for stage in np.flatnonzero(wire.weight):
                    ends = (part.name, stage), (wire.source, stage + wire.offset)
                    seen[ends] = float(ohms[stage])
    between = [ends for ends in seen if not ends[1][0].startswith("own.")]
    assert between
    for a, b in between:
        assert seen[b, a] == pytest.approx(seen[a, b], rel=1e-9)


@needs_ngspice
def test_ngspice_agrees_with_the_emulation():
    backend, circuit, probe = prepared("car", 5)
    told = predict(circuit, backend.level, probe)
    run = simulate(backend, circuit, probe)
    assert run.control_error < 1e-3
    assert run.settling_time() == pytest.approx(told.settling_time, rel=0.05)
