"""Settings of levels and technologies are checked, and named."""

from dataclasses import replace

import numpy as np
import pytest

from ann_dc.errors import NetworkError
from ann_dc.hardware.parts.board_models import model_parameters
from ann_dc.hardware.parts.conditions import Conditions
from ann_dc.hardware.parts.datasheet import TYPICAL, Datasheet, Kind, Tolerances
from ann_dc.hardware.parts.levels import (
    BEHAVIOURAL,
    TRANSISTOR,
    macro,
    ota_c,
    switched_capacitor,
    transistor,
)
from ann_dc.hardware.parts.parasitics import Parasitics


@pytest.mark.parametrize(
    ("make", "field"),
    [
        (lambda: ota_c(linear_range=0.0), "linear_range"),
        (lambda: ota_c(linear_range=np.nan), "linear_range"),
        (lambda: switched_capacitor(step=0.0), "step"),
        (lambda: switched_capacitor(step=np.nan), "step"),
        (lambda: switched_capacitor(step=0.1, clock=-1e6), "clock"),
        (lambda: switched_capacitor(step=0.1, unit_capacitor=0.0), "unit_capacitor"),
        (lambda: switched_capacitor(step=0.1, overlap=-1e-15), "overlap"),
        (lambda: replace(macro(), smallest_resistor=0.0), "smallest_resistor"),
        (lambda: replace(macro(), smallest_capacitor=-1e-12), "smallest_capacitor"),
        (lambda: replace(macro(), smallest_capacitor=np.inf), "smallest_capacitor"),
    ],
)
def test_a_setting_out_of_range_is_named(make, field):
    with pytest.raises(NetworkError, match=f"^{field}: expected"):
        make()


ON_BOARDS = {
    "opamp_cin": {"input_capacitance": 2e-12, "stray_capacitance": 1e-12},
    "opamp_ib": {"bias_current": 3e-12},
    "opamp_pole2": {"second_pole": 3e-12},
    "opamp_imax": {"output_current": 3e-12},
}


@pytest.mark.parametrize("parameter", ON_BOARDS)
def test_every_parasitic_of_op_amps_is_a_parameter_of_their_models(parameter):
    parts = Parasitics(**ON_BOARDS[parameter])
    level = macro(Datasheet(parasitics=parts))
    assert parameter in level.parameters
    assert level.parameters[parameter] == pytest.approx(3e-12)
    others = model_parameters(Parasitics(bias_current=1e-30), "macro")
    for name in others.keys() - {parameter, "opamp_ib"}:
        assert level.parameters[name] == others[name]


def test_levels_without_parasitics_of_op_amps_have_the_parameters_that_they_had():
    plain = macro()
    other = macro(Datasheet(a0=1e6, parasitics=Parasitics(multiplier_noise=1e-6)))
    assert not any(name in plain.parameters for name in ON_BOARDS)
    assert plain.parameters == other.parameters
    assert "opamp_cin" not in plain.parameters


@pytest.mark.parametrize("level", [BEHAVIOURAL, TRANSISTOR, transistor(area=4.0), ota_c()])
def test_parasitics_that_no_netlist_would_have_are_refused(level):
    own = level.datasheet.parasitics
    for name in ("bias_current", "stray_capacitance", "multiplier_feedthrough"):
        datasheet = replace(level.datasheet, parasitics=replace(own, **{name: 1e-9}))
        with pytest.raises(NetworkError, match=f"parasitics, {name}: .* use macro models"):
            replace(level, datasheet=datasheet)
    assert replace(level, datasheet=replace(level.datasheet, parasitics=own)).name == level.name


@pytest.mark.parametrize("name", ["stray_capacitance", "multiplier_feedthrough", "bias_current"])
def test_a_unit_that_was_forgotten_is_told(name):
    with pytest.raises(NetworkError, match=f"{name}: expected a number from 0 to 1 .* got 8.0"):
        Parasitics(**{name: 8.0})


# ---- elsewhere -----------------------------------------------------------------------------------

PARTS = Tolerances(resistor=1e-3, gain=1e-2, resistor_drift=1e-5)
BOARD = macro(Datasheet(a0=1e5, output_swing=14.0, multiplier_output_swing=12.0, tolerances=PARTS))


def test_rails_follow_the_supplies_and_tolerances_the_temperature():
    there = BOARD.at(Conditions(supply=0.9, temperature=77.0))
    assert (there.datasheet.output_swing, there.datasheet.multiplier_output_swing) == pytest.approx(
        (12.6, 10.8)
    )
    assert there.limit == pytest.approx(10.8)
    assert there.tolerances.size(Kind.RESISTOR) == pytest.approx(1.5e-3)
    assert there.tolerances.size(Kind.GAIN) == 1e-2
    assert BOARD.tolerances.size(Kind.RESISTOR) == 1e-3


def test_parts_of_which_nothing_is_known_are_typical_and_those_without_errors_ideal():
    assert macro().tolerances == TYPICAL
    assert macro(tolerances=Tolerances()).tolerances == Tolerances()
    assert ota_c().tolerances == TYPICAL.without([Kind.OFFSET])


def test_a_level_goes_from_place_to_place_as_if_straight_there():
    way = BOARD.at(Conditions(supply=0.5, temperature=-40.0)).at(Conditions(supply=1.1))
    straight = BOARD.at(Conditions(supply=1.1))
    assert way.datasheet.output_swing == pytest.approx(straight.datasheet.output_swing)
    assert way.tolerances == straight.tolerances


def test_ideal_parts_have_no_rails_anywhere():
    low = macro().at(Conditions(supply=0.8)).datasheet
    assert low == macro().datasheet


@pytest.mark.parametrize("level", [BOARD, ota_c()], ids=lambda level: level.name)
def test_a_corner_of_parts_without_transistors_is_refused_by_name(level):
    with pytest.raises(
        NetworkError, match=f"process: {level.name} parts .* no process corners, got 'ss'"
    ):
        level.at(Conditions(process="ss"))


def test_rails_of_transistors_follow_their_supplies():
    assert TRANSISTOR.at(Conditions(supply=0.9)).limit == pytest.approx(0.9 * TRANSISTOR.limit)


def test_transistors_have_corners():
    assert TRANSISTOR.at(Conditions(process="ss")).conditions.process == "ss"
