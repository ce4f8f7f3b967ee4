"""What parts are like: numbers out of their range are named, and the bandwidth that counts."""

from dataclasses import fields, replace

import numpy as np
import pytest

from ann_dc.errors import NetworkError
from ann_dc.hardware.parts import POSITIVE, Conditions, Datasheet, Kind, Tolerances

SIZES = [field.name for field in fields(Tolerances)]


@pytest.mark.parametrize("name", SIZES)
@pytest.mark.parametrize("value", [-1e-3, np.nan, np.inf])
def test_a_spread_out_of_range_is_named(name, value):
    with pytest.raises(NetworkError, match=f"tolerances, {name}: expected"):
        Tolerances(**{name: value})


def test_a_bound_is_a_uniform_error_and_all_else_a_standard_deviation():
    sizes = Tolerances(resistor=0.03, capacitor=0.06, offset=1e-3, gain=2e-2, product_offset=5e-3)
    found = [sizes.deviation(kind) for kind in Kind]
    np.testing.assert_allclose(found, [0.03 / 3**0.5, 0.06 / 3**0.5, 1e-3, 2e-2, 5e-3])


@pytest.mark.parametrize("kelvin", [-40.0, 60.0])
def test_bounds_of_a_drift_add_up_and_its_deviations_as_squares(kelvin):
    sizes = Tolerances(resistor=1e-3, offset=3e-5, resistor_drift=1e-5, offset_drift=1e-6, gain=0.1)
    there = sizes.at(Conditions(temperature=27.0 + kelvin))
    assert there.resistor == pytest.approx(1e-3 + 1e-5 * abs(kelvin))
    assert there.offset == pytest.approx(np.hypot(3e-5, 1e-6 * kelvin))
    assert there.gain == 0.1
    assert there.at(Conditions(temperature=85.0)) == there  # known for where it stands


def test_nothing_drifts_at_room_temperature():
    sizes = Tolerances(resistor=1e-3, offset=3e-5, resistor_drift=1e-5, offset_drift=1e-6)
    room = sizes.at(Conditions(supply=0.9))
    assert room == replace(sizes, resistor_drift=0.0, offset_drift=0.0)


@pytest.mark.parametrize("name", POSITIVE)
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
