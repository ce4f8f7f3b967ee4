"""Settings of levels and technologies are checked, and named."""

import numpy as np
import pytest

from ann_dc.errors import NetworkError
from ann_dc.hardware.parts import ota_c, switched_capacitor


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
    ],
)
def test_a_setting_out_of_range_is_named(make, field):
    with pytest.raises(NetworkError, match=f"^{field}: expected"):
        make()
