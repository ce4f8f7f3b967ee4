"""Larger transistors: what falls with their area, what grows with it, and where it is refused."""

from dataclasses import replace

import numpy as np
import pytest
from wired import prepared

from ann_dc.backends.spice.netlist.deck import deck_of
from ann_dc.errors import NetworkError
from ann_dc.hardware.parts.levels import TRANSISTOR, transistor
from ann_dc.hardware.parts.parasitics import MultiplierLaw
from ann_dc.hardware.parts.transistors import transistor_sheet


def test_mismatch_falls_with_the_root_of_the_area():
    small, large = (transistor(area=area).tolerances for area in (1.0, 16.0))
    assert small.offset == pytest.approx(3.3e-3, rel=0.01)  # 10 mV um, 34 and 15 um^2
    for kind in ("offset", "product_offset"):
        assert getattr(small, kind) == pytest.approx(4 * getattr(large, kind))
    assert small.resistor == large.resistor


def test_capacitances_grow_and_multipliers_become_slower():
    areas = (1.0, 4.0, 16.0, 36.0, 64.0)
    sheets = [transistor_sheet(area) for area in areas]
    farads = [sheet.parasitics.input_capacitance for sheet in sheets]
    np.testing.assert_allclose(farads[:4], [55e-15, 191e-15, 707e-15, 1.55e-12], rtol=0.01)
    ratios = [sheets[0].multiplier_bandwidth / sheet.multiplier_bandwidth for sheet in sheets]
    measured = np.array([26.37, 17.23, 8.90, 5.36, 3.52])  # mul4q_transistor_area.cir, in MHz
    np.testing.assert_allclose(ratios, measured[0] / measured, rtol=0.02)


def test_a_deck_says_the_area_behind_the_models():
    circuit, _ = prepared(False)
    text, same = (
        deck_of(circuit, level, duration=1.0).text for level in (transistor(area=36.0), TRANSISTOR)
    )
    assert text.index(".param area=1\n") < text.index(".param area=36\n")
    assert text.replace(".param area=36\n", "") == same


@pytest.mark.parametrize("area", [0.5, 65.0])
def test_areas_that_were_not_measured_are_refused(area):
    with pytest.raises(NetworkError, match="area: expected 1 to 64"):
        transistor(area=area)


def test_a_law_has_numbers():
    with pytest.raises(NetworkError, match="multiplier_law, bow"):
        MultiplierLaw(bow=(float("inf"), 0.0, 0.0))


def test_small_gains_are_made_by_resistors_of_y_where_a_law_says_so():
    law = MultiplierLaw(
        gain=(1.0, 2.0, 4.0), gain_y=(1.0, 2.0, 4.0), gain_o=(1.0, 2.0, 4.0),
        bend_y=(1.0, 2.0, 4.0), follow=(1.0, 2.0, 4.0), bow=(1.0, 2.0, 4.0),
    )  # fmt: skip
    of = {volts: 1.0 + 2.0 / volts + 4.0 * volts for volts in (0.5, 2.0, 4.0)}
    for least, gain, y, output in (
        (0.0, 0.25, 2.0, 0.5),
        (1.0, 0.5, 4.0, 2.0),
        (1.0, 2.0, 2.0, 4.0),
    ):
        at = replace(law, least_gain=least).at(2.0, gain)
        assert (at.gain[0], at.gain_y[0]) == (of[2.0], of[y])
        assert (at.gain_o[0], at.follow[0], at.bow[0]) == (of[output],) * 3
        assert at.bend_y[0] == of[y] * (2.0 / y) ** 2
