"""The example without obstacles: what holds, and what is printed."""

import numpy as np
import pytest

import ann_dc
from ann_dc.plotting.paper.paths import free_controls, free_paths

BACKEND = ann_dc.OdeBackend(verify=False)


@pytest.fixture(scope="module")
def optimum():
    return ann_dc.solve(ann_dc.plants.car(), backend=BACKEND)


@pytest.fixture(scope="module")
def lost():
    return ann_dc.solve(ann_dc.plants.car(), form=ann_dc.switch("S1"), backend=BACKEND)


def lines(axes):
    return {line.get_label(): line for line in axes.lines}


def test_what_holds_stands_beside_what_is_printed(optimum, lost):
    holds, printed = free_paths(optimum, optimum, lost).axes
    path = lines(holds)["T_0, the optimum"]
    np.testing.assert_array_equal(path.get_xydata().T, [optimum["x"], optimum["y"]])
    assert "without dB/dq (S3)" in lines(printed)
    moments = [name for name in lines(printed) if name.startswith("(16), (17) after")]
    assert 1 <= len(moments) <= 3


def test_controls_have_units(optimum, lost):
    axes = free_controls(optimum, optimum, lost).axes
    assert [one.get_ylabel() for one in axes[::2]] == ["u_1 = nu (m/s)", "u_2 = eta (rad/s)"]
    np.testing.assert_array_equal(axes[0].lines[0].get_ydata()[:-1], optimum["nu"])
