"""What a circuit takes: parts counted in its netlist, their power, and the bill."""

import csv
import io
import math
import re
from collections import Counter
from functools import cache

import numpy as np
import pytest
from designs import coordinated, small

from ann_dc.backends.spice.backend import SpiceBackend
from ann_dc.backends.spice.netlist.deck import Writer, deck_of
from ann_dc.errors import NetworkError
from ann_dc.gain_design.procedure import design
from ann_dc.gain_design.recipe import WITHOUT_COORDINATORS
from ann_dc.hardware.circuit.bill import COLUMNS, bill_of
from ann_dc.hardware.circuit.cost import (
    CAPACITOR,
    GENERATOR,
    GENERATOR_MULTIPLIERS,
    MULTIPLIER,
    OP_AMP,
    OTA,
    PARTS,
    RESISTOR,
    SWITCH,
    Cost,
    cost,
    parts_of,
)
from ann_dc.hardware.parts import presets
from ann_dc.hardware.parts.datasheet import Datasheet
from ann_dc.hardware.parts.e_series import E24, E24_PAIRS, E96, EXACT
from ann_dc.hardware.parts.levels import BEHAVIOURAL, macro, ota_c, switched_capacitor

LEVELS = {
    "behavioural": BEHAVIOURAL,
    "macro": macro(),
    "differential": macro(differential=True),
    "ota-c": ota_c(a0=1e4),
    "switched-capacitor": switched_capacitor(a0=1e6, step=0.1),
}


@cache
def prepared(name: str, differential: bool = False):
    """A problem of the suite over four stages."""
    network = design(small(name), recipe=WITHOUT_COORDINATORS).network
    return SpiceBackend(level=macro(differential=differential)).prepare(network)


def written(level, name: str = "double_integrator"):
    circuit, _ = prepared(name, level.technology.differential)
    return deck_of(circuit, level, duration=1.0)


# ---- parts ---------------------------------------------------------------------------------------

LEAVES = {
    **dict.fromkeys(("opamp", "opamp_fd"), OP_AMP),
    **dict.fromkeys(("ota", "ota_diff"), OTA),
    **dict.fromkeys(("mul4q", "mul4q_fd"), MULTIPLIER),
}
"""Subcircuits that are bought as one."""


def cards_of(text: str) -> dict[str, list[list[str]]]:
    """Words of the elements of every subcircuit, and of the top level under ``""``."""
    cards: dict[str, list[list[str]]] = {"": []}
    place = ""
    for line in text.lower().replace("\n+ ", " ").splitlines()[1:]:
        words = [word for word in line.split() if "=" not in word]
        if line.startswith(".subckt"):
            place = words[1]
            cards[place] = []
        elif line.startswith(".ends"):
            place = ""
        elif line[:1] in "xrcs" and words:
            cards[place].append(words)
    return cards


def counted(text: str) -> dict[str, int]:
    """Parts of a netlist, from its top down to elements; it knows nothing of cells by name.

    Not bought: reset switches and their presets (0.1 ohm), output resistances that a model has
    (ro), and stray capacitances (cov).
    """
    cards = cards_of(text)

    def of(name: str) -> Counter:
        return sum((element(words) for words in cards[name]), Counter())

    def element(words: list[str]) -> Counter:
        if words[0][0] == "x":
            kind = words[-1]
            leaf = GENERATOR if kind.startswith("func_") else LEAVES.get(kind)
            return Counter({leaf: 1}) if leaf else of(kind)
        return Counter(
            {
                "r": {RESISTOR: int(words[-1] not in ("0.1", "{ro}"))},
                "c": {CAPACITOR: int(words[-1] != "{cov}")},
                "s": {SWITCH: int("sc_switch" in words)},
            }[words[0][0]]
        )

    return {part: count for part, count in of("").items() if count}


@pytest.mark.parametrize("plant", ["double_integrator", "car"])
@pytest.mark.parametrize("name", LEVELS)
def test_parts_are_those_of_the_netlist(name, plant):
    found = written(LEVELS[name], plant)
    assert found.parts == counted(found.text)
    assert all(type(count) is int and count > 0 for count in found.parts.values())


def test_parts_of_coordinators_are_those_of_the_netlist():
    circuit, _ = SpiceBackend(level=macro()).prepare(coordinated("double_integrator"))
    found = deck_of(circuit, macro(), duration=1.0)
    assert "R_m__" in found.text
    assert found.parts == counted(found.text)


def test_every_cell_of_the_library_is_counted_by_its_own_elements():
    """All but the clock, which a circuit has once."""
    from ann_dc.resources import circuits_path

    cells = {file.stem: file for file in (circuits_path() / "cells").glob("*.cir")}
    assert PARTS.keys() - {"resistor", "function", "mul4q"} == cells.keys() - {"clk2"}
    for name, file in cells.items():
        if name not in ("clk2", *LEAVES):
            text = f"*\n{file.read_text(encoding='utf-8')}\nX1 1 2 3 4 5 {name}\n"
            assert parts_of({name: 1}) == counted(text), name


def test_what_technologies_save():
    """Both signs cost twice R and C and no inverter (an op amp and two R); OTAs need no op amp."""
    single, double, node = (written(LEVELS[n]).parts for n in ("macro", "differential", "ota-c"))
    inverters = single[OP_AMP] - double[OP_AMP]
    assert inverters > 0
    assert double[RESISTOR] == 2 * (single[RESISTOR] - 2 * inverters)
    assert double[CAPACITOR] == 2 * single[CAPACITOR]
    assert OP_AMP not in node
    assert node[CAPACITOR] == single[CAPACITOR]


# ---- what it costs -------------------------------------------------------------------------------


def test_power_is_that_of_all_parts_and_energy_its_time():
    datasheet = Datasheet(amplifier_power=2e-3, multiplier_power=5e-3)
    parts = {OP_AMP: 7, MULTIPLIER: 3, GENERATOR: 2, RESISTOR: 99, CAPACITOR: 12}
    found = cost(parts, datasheet, settling=10e-6)
    watts = 7 * 2e-3 + (3 + 2 * GENERATOR_MULTIPLIERS) * 5e-3
    assert found.power == pytest.approx(watts)
    assert found.energy == pytest.approx(watts * 10e-6)
    assert found.parts == parts
    assert Cost(parts={}, power=2.0, settling=3.0).energy == 6.0


def test_power_that_is_not_known_is_nan():
    parts = {OP_AMP: 7, MULTIPLIER: 3}
    for datasheet in (Datasheet(), Datasheet(amplifier_power=1.0), Datasheet(multiplier_power=1.0)):
        found = cost(parts, datasheet, settling=1e-6)
        assert math.isnan(found.power)
        assert math.isnan(found.energy)
    assert math.isnan(
        cost(parts, Datasheet(amplifier_power=1, multiplier_power=1), math.nan).energy
    )


def test_every_preset_has_a_power():
    parts = written(macro(), "car").parts
    for name, level in ((name, presets.get(name)) for name in presets.names()):
        watts = cost(parts, level.datasheet, settling=1e-6).power
        assert 0.1 < watts < 1000, name


# ---- the bill ------------------------------------------------------------------------------------


def rows_of(
    series, plant: str = "double_integrator", differential: bool = False
) -> list[dict[str, str]]:
    circuit, _ = prepared(plant, differential)
    level = macro(differential=differential)
    return list(csv.DictReader(io.StringIO(bill_of(circuit, level, series)), strict=True))


def passive(rows: list[dict[str, str]]) -> list[dict[str, str]]:
    return [row for row in rows if row["unit"]]


def bought(row: dict[str, str]) -> list[float]:
    return [float(word) for word in row["to buy"].split(" + ")]


def test_a_bill_is_csv_with_a_line_a_component():
    rows = rows_of(EXACT, "car")
    assert tuple(rows[0]) == COLUMNS
    assert all(None not in row and None not in row.values() for row in rows)
    places = [(row["cell"], row["component"]) for row in rows]
    assert len(set(places)) == len(places)
    assert {row["unit"] for row in rows} == {"ohm", "F", ""}
    assert {int(row["cell"]) for row in rows} == {0, 1, 2, 3}
    assert all(row["what"] for row in rows)


@pytest.mark.parametrize("plant", ["double_integrator", "car", "cstr"])
def test_values_are_those_of_the_netlist(plant):
    circuit, _ = prepared(plant)
    rows = passive(rows_of(EXACT, plant))
    found = {(int(row["cell"]), row["component"]): float(row["value"]) for row in rows}
    wanted = {
        (stage, name): value
        for stage in range(4)
        for name, value in Writer(circuit, macro(), {}).cell(stage).values.items()
        if name.startswith(("r_", "rf_", "c_"))
    }
    assert wanted.keys() <= found.keys()
    assert {key: found[key] for key in wanted} == pytest.approx(wanted, rel=1e-5)
    beyond = [place for place in found.keys() - wanted.keys() if not place[1].startswith("e_n_")]
    assert {stage for stage, _ in beyond} <= {0, 3}  # they end at ground, and load an op amp


@pytest.mark.parametrize("name", ["macro", "differential"])
@pytest.mark.parametrize("plant", ["double_integrator", "car"])
def test_the_bill_has_all_parts_of_the_netlist(plant, name):
    rows = rows_of(EXACT, plant, differential=name == "differential")
    parts = written(LEVELS[name], plant).parts
    total = Counter()
    for row in rows:
        total[row["unit"] or row["to buy"]] += int(row["count"])
    assert total.pop("F") == parts[CAPACITOR]
    assert total.pop("op amp") == parts[OP_AMP]
    assert total.pop("ohm") == parts[RESISTOR]
    assert total.total() == parts.get(MULTIPLIER, 0) + parts.get(GENERATOR, 0)


@pytest.mark.parametrize("series", [E24, E96, E24_PAIRS], ids=lambda series: series.name)
def test_what_to_buy_is_of_the_series(series):
    for row in passive(rows_of(series)):
        value, parts = float(row["value"]), bought(row)
        assert float(row["deviation"]) == pytest.approx(sum(parts) / value - 1, rel=5e-3, abs=1e-5)
        if row["unit"] == "F":
            assert parts == [value]
            continue
        assert len(parts) <= (2 if series.pairs else 1)
        for ohms in parts:
            mantissa = ohms / 10 ** math.floor(math.log10(ohms) + 1e-9)
            assert np.isclose(mantissa, series.mantissas, rtol=1e-6).any(), row
        assert sum(parts) == pytest.approx(float(series.nearest(np.array(value))), rel=1e-5)


def test_exact_resistors_are_bought_as_they_are():
    for row in passive(rows_of(EXACT)):
        assert row["value"] == row["to buy"]
        assert float(row["deviation"]) == 0


def test_the_same_circuit_has_the_same_bill():
    circuit, _ = prepared("double_integrator")
    again, _ = SpiceBackend(level=macro()).prepare(circuit.schematic.network)
    text = bill_of(circuit, macro(), E24)
    assert text == bill_of(again, macro(), E24)
    assert "\r" not in text
    assert not re.search(r"\d{2}:\d{2}|20\d\d-", text)


@pytest.mark.parametrize("name", ["ota-c", "switched-capacitor"])
def test_what_has_no_resistors_has_no_bill(name):
    circuit, _ = prepared("double_integrator", differential=True)
    with pytest.raises(NetworkError, match=f"^bill: level {name} is not built of op amps"):
        bill_of(circuit, LEVELS[name], E24)
