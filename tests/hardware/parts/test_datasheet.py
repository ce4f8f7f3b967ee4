"""What parts are like: numbers out of their range are named, and the bandwidth that counts."""

import numpy as np
import pytest

from ann_dc.errors import NetworkError
from ann_dc.hardware.parts import POSITIVE, Datasheet, Kind, Tolerances


@pytest.mark.parametrize("kind", Kind)
@pytest.mark.parametrize("value", [-1e-3, np.nan, np.inf])
def test_a_spread_out_of_range_is_named(kind, value):
    with pytest.raises(NetworkError, match=f"tolerances, {kind.value}: expected"):
        Tolerances(**{kind.value: value})


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
