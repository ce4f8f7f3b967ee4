"""What a circuit takes: parts of the library's cells, their power and their energy."""

import math
from functools import cache

import pytest
from counting import LEAVES, counted
from designs import small

from ann_dc.backends.spice.backend import SpiceBackend
from ann_dc.backends.spice.netlist.deck import deck_of
from ann_dc.gain_design.gain_rule import DIAGONAL_RULE
from ann_dc.gain_design.procedure import design
from ann_dc.hardware.circuit.cost import (
    CAPACITOR,
    GENERATOR,
    GENERATOR_MULTIPLIERS,
    MULTIPLIER,
    OP_AMP,
    PARTS,
    RESISTOR,
    Cost,
    cost_of,
    parts_of,
)
from ann_dc.hardware.parts import presets
from ann_dc.hardware.parts.datasheet import Datasheet
from ann_dc.hardware.parts.levels import macro, ota_c
from ann_dc.resources import circuits_path

CLAMPS = "clamp_low", "clamp_high"


@cache
def parts_at(level, name: str = "double_integrator"):
    """Parts of a problem of the suite over four stages."""
    network = design(small(name), gain_rule=DIAGONAL_RULE).network
    differential = level.technology.differential
    circuit, _ = SpiceBackend(level=macro(differential=differential)).prepare(network)
    return deck_of(circuit, level, duration=1.0).parts


def test_every_cell_of_the_library_is_counted_by_its_own_elements():
    """All but the clock, which a circuit has once."""
    cells = {file.stem: file for file in (circuits_path() / "cells").glob("*.cir")}
    assert PARTS.keys() - {
        "resistor",
        "function",
        "mul4q",
        "mul4q_base",
        "capacitor",
        "follower",
        "negative",
        *CLAMPS,
    } == cells.keys() - {"clk2"}
    for name, file in cells.items():
        if name not in ("clk2", *LEAVES):
            text = f"*\n{file.read_text(encoding='utf-8')}\nX1 1 2 3 4 5 {name}\n"
            assert parts_of({name: 1}) == counted(text), name
    clamps = (circuits_path() / "models" / "macro" / "clamp.lib").read_text(encoding="utf-8")
    for name in CLAMPS:
        assert parts_of({name: 1}) == counted(f"*\n{clamps}\nX1 1 2 {name}\n"), name


def test_what_technologies_save():
    """Both signs cost twice R and C and no inverter (an op amp and two R); OTAs need no op amp."""
    single, double, node = (
        parts_at(level) for level in (macro(), macro(differential=True), ota_c(a0=1e4))
    )
    inverters = single[OP_AMP] - double[OP_AMP]
    assert inverters > 0
    assert double[RESISTOR] == 2 * (single[RESISTOR] - 2 * inverters)
    assert double[CAPACITOR] == 2 * single[CAPACITOR]
    assert OP_AMP not in node
    assert node[CAPACITOR] == single[CAPACITOR]


def test_power_is_that_of_all_parts_and_energy_its_time():
    datasheet = Datasheet(amplifier_power=2e-3, multiplier_power=5e-3)
    parts = {OP_AMP: 7, MULTIPLIER: 3, GENERATOR: 2, RESISTOR: 99, CAPACITOR: 12}
    found = cost_of(parts, datasheet, settling=10e-6)
    watts = 7 * 2e-3 + (3 + 2 * GENERATOR_MULTIPLIERS) * 5e-3
    assert found.power == pytest.approx(watts)
    assert found.energy == pytest.approx(watts * 10e-6)
    assert found.parts == parts
    assert Cost(parts={}, power=2.0, settling=3.0).energy == 6.0


def test_power_that_is_not_known_is_nan():
    parts = {OP_AMP: 7, MULTIPLIER: 3}
    for datasheet in (Datasheet(), Datasheet(amplifier_power=1.0), Datasheet(multiplier_power=1.0)):
        found = cost_of(parts, datasheet, settling=1e-6)
        assert math.isnan(found.power)
        assert math.isnan(found.energy)
    assert math.isnan(
        cost_of(parts, Datasheet(amplifier_power=1, multiplier_power=1), math.nan).energy
    )


def test_power_without_multipliers_needs_none_of_theirs():
    found = cost_of({OP_AMP: 7}, Datasheet(amplifier_power=2e-3), settling=1e-6, loads=0.5)
    assert found.power == pytest.approx(0.514)
    assert found.loads == 0.5


def test_every_preset_has_a_power():
    parts = parts_at(macro(), "car")
    for name in presets.names():
        watts = cost_of(parts, presets.get(name).datasheet, settling=1e-6).power
        assert 0.1 < watts < 1000, name
