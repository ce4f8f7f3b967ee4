"""The bill: every part of every cell, its value, and what to buy for it."""

import csv
import io
import math
import re
from collections import Counter
from functools import cache

import numpy as np
import pytest
from designs import small

from ann_dc.backends.spice.backend import SpiceBackend
from ann_dc.backends.spice.netlist.cells import cell_of
from ann_dc.backends.spice.netlist.deck import deck_of
from ann_dc.backends.spice.netlist.values import Nodes, Values
from ann_dc.errors import NetworkError
from ann_dc.gain_design.gain_rule import DIAGONAL_RULE
from ann_dc.gain_design.procedure import design
from ann_dc.hardware.circuit.bill import COLUMNS, bill_of
from ann_dc.hardware.circuit.cost import CAPACITOR, GENERATOR, MULTIPLIER, OP_AMP, RESISTOR
from ann_dc.hardware.parts.e_series import E24, E24_PAIRS, E96, EXACT
from ann_dc.hardware.parts.levels import macro, ota_c, switched_capacitor

LEVELS = {
    "macro": macro(),
    "differential": macro(differential=True),
    "ota-c": ota_c(a0=1e4),
    "switched-capacitor": switched_capacitor(a0=1e6, step=0.1),
}


@cache
def prepared(name: str, differential: bool = False):
    """A problem of the suite over four stages."""
    network = design(small(name), gain_rule=DIAGONAL_RULE).network
    return SpiceBackend(level=macro(differential=differential)).prepare(network)


def cell_values(circuit, stage: int) -> dict[str, float]:
    """Values of a cell of the netlist, by name."""
    values = Values(circuit=circuit, deviations={})
    return cell_of(Nodes(circuit), values, macro(), stage).values


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


@pytest.mark.sampled(2)
@pytest.mark.parametrize("plant", ["double_integrator", "car", "cstr"])
def test_values_are_those_of_the_netlist(plant):
    circuit, _ = prepared(plant)
    rows = passive(rows_of(EXACT, plant))
    found = {(int(row["cell"]), row["component"]): float(row["value"]) for row in rows}
    wanted = {
        (stage, name): value
        for stage in range(4)
        for name, value in cell_values(circuit, stage).items()
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
    parts = deck_of(prepared(plant, name == "differential")[0], LEVELS[name], duration=1.0).parts
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
        taken = E24 if row["unit"] == "F" else series
        assert len(parts) <= (2 if taken.pairs else 1)
        for part in parts:
            mantissa = part / 10 ** math.floor(math.log10(part) + 1e-9)
            assert np.isclose(mantissa, taken.mantissas, rtol=1e-6).any(), row
        assert sum(parts) == pytest.approx(float(taken.nearest(np.array(value))), rel=1e-5)


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
    with pytest.raises(NetworkError, match=f"^bill: level {name} has no op amps"):
        bill_of(circuit, LEVELS[name], E24)
