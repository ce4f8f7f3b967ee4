"""Fully differential op amps in ngspice: both signs, no inverters."""

import re
from functools import cache

import numpy as np
import pytest
from counting import counted
from preconditioner_networks import with_preconditioner
from simulator import needs_ngspice
from wired import instances, neighbour_wired, prepared

from ann_dc.backends.spice.backend import SpiceBackend, simulate
from ann_dc.backends.spice.netlist.deck import deck_of
from ann_dc.fidelity.prediction import predict
from ann_dc.hardware.circuit.cost import NEGATIVE, RESISTOR
from ann_dc.hardware.circuit.scaling import to_ground
from ann_dc.hardware.parts import presets
from ann_dc.hardware.parts.datasheet import Datasheet, Tolerances
from ann_dc.hardware.parts.levels import macro
from ann_dc.hardware.schematic.elements import GridNode
from ann_dc.network.preconditioners.base import PreconditionerKind


def run_of(level):
    return simulate(SpiceBackend(level=level), *prepared(level.technology.differential))


@pytest.mark.slow
@needs_ngspice
def test_differential_op_amps_settle_at_the_optimum_without_inverters():
    run = run_of(macro(a0=1e6, differential=True))
    assert run.control_error < 1e-4
    assert run.settled()
    assert not instances(run.deck.text, "inv")
    assert ".subckt inv " not in run.deck.text
    circuit, _ = prepared(False)
    single = deck_of(circuit, macro(), duration=1.0).text
    assert instances(single, "inv")
    both = {kind: len(instances(run.deck.text, f"{kind}_fd")) for kind in ("integ", "pi_cell")}
    assert both == {kind: len(instances(single, kind)) for kind in both}


@needs_ngspice
def test_differential_circuits_that_are_off_settle_where_their_emulation_does():
    """Each half sees half of an offset, and there are no inverters to be off."""
    tolerances = Tolerances(resistor=1e-2, offset=1e-3, gain=1e-2, product_offset=1e-3)
    level = macro(Datasheet(a0=1e5, tolerances=tolerances), differential=True)
    run = SpiceBackend(level=level, seed=3).run(neighbour_wired("double_integrator", 5))
    off = SpiceBackend(level=level, seed=3).deviations(run.circuit)
    meaning = predict(run.circuit, level, run.probe, off)
    assert run.control_error == pytest.approx(meaning.control_error, rel=1e-3)


def seeded(seed: int | None) -> str:
    level = presets.get("ad8065_ad835")
    backend = SpiceBackend(level=level, seed=seed)
    circuit, probe = prepared(False, 4)
    return deck_of(
        circuit, level, duration=float(probe.time[-1]), deviations=backend.deviations(circuit)
    ).text


def test_a_seed_decides_the_numbers_and_nothing_else():
    assert seeded(1) == seeded(1)
    assert seeded(1) != seeded(2)

    def without_numbers(text: str) -> str:
        return re.sub(r"=[-+.\de]+", "=", text.replace("\n+ ", " "))

    assert without_numbers(seeded(1)) == without_numbers(seeded(2))


# ---- grids ---------------------------------------------------------------------------------------


@cache
def grid(name: str, horizon: int | None, bandwidth_margin: float = 60.0):
    backend = SpiceBackend(level=macro(), bandwidth_margin=bandwidth_margin, node_lag=2e-3)
    return backend, *backend.prepare(
        with_preconditioner(name, PreconditionerKind.RESISTIVE_GRID, horizon)
    )


def test_parts_are_those_of_the_netlist():
    _, circuit, _ = grid("car", 5)
    deck = deck_of(circuit, macro(), duration=1.0)
    ours = dict(deck.parts)
    ours[RESISTOR] += ours.pop(NEGATIVE, 0)
    assert counted(deck.text) == ours


def test_conductances_add_up_to_those_of_the_nodes():
    """All that ends at a node, and what goes to ground, is its conductance; lag is C over that."""
    _, circuit, _ = grid("car", 5)
    for part in circuit.schematic.parts:
        if isinstance(part, GridNode):
            ohms, total = circuit.resistors[part.name], circuit.conductances[part.name]
            rest = to_ground(total, ohms)
            np.testing.assert_allclose((1 / ohms).sum(axis=0) + rest, total, rtol=1e-9)


def test_a_resistor_between_two_nodes_is_the_same_seen_from_either():
    _, circuit, _ = grid("car", 5)
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


@pytest.mark.slow
@needs_ngspice
def test_ngspice_agrees_with_the_emulation():
    backend, circuit, probe = grid("car", 5)
    reported = predict(circuit, backend.level, probe)
    run = simulate(backend, circuit, probe)
    assert run.control_error == pytest.approx(reported.control_error, rel=0.05)
    assert run.settling_time() == pytest.approx(reported.settling_time, rel=0.02)
