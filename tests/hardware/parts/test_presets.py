"""Presets have the figures of their files, by name."""

import math
import re

import pytest

from ann_dc.errors import UnknownNameError
from ann_dc.hardware.parts import presets
from ann_dc.hardware.parts.board_models import MACRO_PARAMETERS
from ann_dc.hardware.parts.conditions import Conditions
from ann_dc.hardware.parts.datasheet import Kind
from ann_dc.resources import circuits_path


def test_every_preset_has_the_figures_of_its_file():
    folder = circuits_path() / "models" / "presets"
    known = {name: presets.get(name) for name in presets.names()}
    assert known.keys() == {file.stem for file in folder.glob("*.lib")}
    for name, level in known.items():
        text = (folder / f"{name}.lib").read_text(encoding="utf-8")
        figures = {k: float(v) for k, v in re.findall(r"^\.param (\w+)=(\S+)$", text, re.MULTILINE)}
        tolerances = level.datasheet.tolerances
        parts = level.datasheet.parasitics
        stated = {k: v for k, v in level.parameters.items() if k != "opamp_pole2"}  # none is known
        found = stated | {
            "input_capacitance": parts.input_capacitance,
            "stray_capacitance": parts.stray_capacitance,
            "opamp_noise": parts.amplifier_noise,
            **({"opamp_ib_doubling": d} if (d := parts.bias_doubling) < math.inf else {}),
            "mul_noise": parts.multiplier_noise,
            "full_scale": level.full_scale,
            "resistor_tolerance": tolerances.resistor,
            "opamp_vos": tolerances.offset,
            "mul_ge": tolerances.gain,
            "mul_offset": tolerances.product_offset,
            "resistor_drift": tolerances.resistor_drift,
            "opamp_drift": tolerances.offset_drift,
        }
        assert {figure: figures[figure] for figure in found} == pytest.approx(found), name
        assert found.keys() > MACRO_PARAMETERS.keys()


def test_a_preset_by_name():
    datasheet = presets.get("tl072_ad633").datasheet
    assert (datasheet.gbw, datasheet.a0, datasheet.slew) == (4e6, 2e5, 13e6)
    assert datasheet.usable_bandwidth == 3e6  # three times that of its multipliers
    assert (datasheet.tolerances.offset, datasheet.tolerances.resistor) == (3e-3, 0.01)
    assert presets.get("tl072_ad633").full_scale == 10


def test_parts_of_every_preset_drift():
    for name in presets.names():
        level = presets.get(name)
        room, hot = level.datasheet.tolerances, level.at(Conditions(temperature=127.0)).tolerances
        assert 0 < room.resistor_drift < 1e-4, name
        assert 0 < room.offset_drift < 1e-4, name
        bound = room.resistor + 100 * room.resistor_drift
        assert hot.size(Kind.RESISTOR) == pytest.approx(bound), name
        spread = math.hypot(room.offset, 100 * room.offset_drift)
        assert hot.size(Kind.OFFSET) == pytest.approx(spread), name


@pytest.mark.parametrize("name", presets.names())
def test_what_leaks_into_an_op_amp_grows_with_heat(name):
    room = presets.get(name)
    hot = room.at(Conditions(temperature=127.0))
    times = 2 ** (100 / room.datasheet.parasitics.bias_doubling)
    assert times == (1.0 if name == "zero_drift_trimmed" else 1024.0)
    amperes = room.datasheet.parasitics.bias_current
    assert hot.parameters["opamp_ib"] == pytest.approx(times * amperes, rel=1e-12)
    back = hot.at(Conditions()).datasheet.parasitics
    assert back.bias_current == pytest.approx(amperes, rel=1e-12)


PUBLISHED = {
    "tl072_ad633": (4e6, 10e-3, 15e-9, 1e6, 10.0),
    "opa192_ad734": (10e6, 65e-3, 5.5e-9, 10e6, 10.0),
    "ad8065_ad835": (65e6, 30e-3, 7e-9, 250e6, 1.0),
}
"""As datasheets have them: Hz and A of op amps, V/rtHz, Hz of multipliers, volts."""


@pytest.mark.parametrize("name", PUBLISHED)
def test_figures_are_those_of_datasheets(name):
    gbw, amperes, noise, bandwidth, volts = PUBLISHED[name]
    level = presets.get(name)
    sheet, parts = level.datasheet, level.datasheet.parasitics
    assert (sheet.gbw, sheet.multiplier_bandwidth, level.full_scale) == (gbw, bandwidth, volts)
    assert (parts.output_current, parts.amplifier_noise) == (amperes, noise)


def test_an_unknown_preset_lists_those_that_there_are():
    with pytest.raises(UnknownNameError, match=r"'lm741'.*choose one of: .*tl072_ad633") as meaning:
        presets.get("lm741")
    assert all(name in str(meaning.value) for name in presets.names())
