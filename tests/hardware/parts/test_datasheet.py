"""What parts are like: numbers out of their range are named, and the bandwidth that counts."""

from dataclasses import fields

import numpy as np
import pytest

from ann_dc.errors import NetworkError
from ann_dc.hardware.parts.conditions import Conditions
from ann_dc.hardware.parts.datasheet import Datasheet, Kind, Tolerances

SIZES = [field.name for field in fields(Tolerances) if field.name != "kelvin"]


@pytest.mark.parametrize("name", SIZES)
@pytest.mark.parametrize("value", [-1e-3, np.nan, np.inf])
def test_a_spread_out_of_range_is_named(name, value):
    with pytest.raises(NetworkError, match=f"tolerances, {name}: expected"):
        Tolerances(**{name: value})


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_distance_to_room_temperature_is_a_number(value):
    with pytest.raises(NetworkError, match="tolerances, kelvin: expected a finite number"):
        Tolerances(kelvin=value)


def test_a_bound_is_a_uniform_error_and_all_else_a_standard_deviation():
    sizes = Tolerances(resistor=0.03, capacitor=0.06, offset=1e-3, gain=2e-2, product_offset=5e-3)
    found = [sizes.deviation(kind) for kind in Kind]
    np.testing.assert_allclose(found, [0.03 / 3**0.5, 0.06 / 3**0.5, 1e-3, 2e-2, 5e-3])


DRIFTING = Tolerances(resistor=1e-3, offset=3e-5, resistor_drift=1e-5, offset_drift=1e-6, gain=0.1)


@pytest.mark.parametrize("kelvin", [-40.0, 60.0])
def test_bounds_add_up_and_deviations_as_squares(kelvin):
    there = DRIFTING.at(Conditions(temperature=27.0 + kelvin))
    assert there.drift(Kind.RESISTOR) == pytest.approx(1e-5 * kelvin)
    assert there.drift(Kind.OFFSET) == pytest.approx(1e-6 * kelvin)
    assert there.size(Kind.RESISTOR) == pytest.approx(1e-3 + 1e-5 * abs(kelvin))
    assert there.deviation(Kind.RESISTOR) == pytest.approx(np.hypot(1e-3, 1e-5 * kelvin) / 3**0.5)
    for found in (there.size(Kind.OFFSET), there.deviation(Kind.OFFSET)):
        assert found == pytest.approx(np.hypot(3e-5, 1e-6 * kelvin))
    assert (there.size(Kind.GAIN), there.deviation(Kind.GAIN), there.drift(Kind.GAIN)) == (
        0.1,
        0.1,
        0,
    )


def test_nothing_drifts_at_room_temperature_and_parts_that_do_not_drift_nowhere():
    assert DRIFTING.at(Conditions(supply=0.9)) == DRIFTING
    assert DRIFTING.at(Conditions(temperature=85.0)).at(Conditions()) == DRIFTING
    steady = Tolerances(resistor=1e-3)
    assert steady.at(Conditions(temperature=85.0)) == steady


def test_parts_without_errors_of_a_kind_do_not_drift_in_it():
    there = DRIFTING.at(Conditions(temperature=85.0)).without([Kind.OFFSET, Kind.GAIN])
    assert [there.size(kind) > 0 for kind in Kind] == [True, False, False, False, False]


@pytest.mark.parametrize(
    "name",
    [
        "a0",
        "slew",
        "output_swing",
        "multiplier_output_swing",
        "multiplier_bandwidth",
        "function_bandwidth",
    ],
)
@pytest.mark.parametrize("value", [0.0, -1.0, np.nan])
def test_hardware_out_of_range_is_named(name, value):
    with pytest.raises(NetworkError, match=f"^{name}: expected"):
        Datasheet(**{name: value})


@pytest.mark.parametrize(
    ("name", "value"), [("gbw", np.inf), ("gbw", 0.0), ("rout", -1.0), ("rout", np.inf)]
)
def test_hardware_that_sets_the_time_scale_or_a_load_is_finite(name, value):
    with pytest.raises(NetworkError, match=f"^{name}: expected"):
        Datasheet(**{name: value})


def test_network_time_follows_the_op_amps_or_three_times_slower_multipliers():
    assert Datasheet(gbw=5e6).usable_bandwidth == 5e6
    assert Datasheet(gbw=5e6, multiplier_bandwidth=1e6).usable_bandwidth == 3e6
    assert Datasheet(gbw=5e6, function_bandwidth=1e6).usable_bandwidth == 3e6
