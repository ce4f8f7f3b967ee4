"""Controls over time."""

import pytest

from ann_dc import plotting


def test_time_axis_is_in_seconds(car):
    figure = plotting.controls(car)
    assert figure.axes[-1].get_xlabel() == "time k dt (s)"
    assert figure.axes[-1].get_xlim() == pytest.approx((0.0, 0.9))
