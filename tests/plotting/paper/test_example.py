"""Figures 4 and 5: what holds, what is printed, and room for paths around obstacles."""

import numpy as np
import pytest

import ann_dc
from ann_dc.plotting.paper import Disc, Drawn, Panel, figure_4, figure_5

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
    holds, printed = figure_4(optimum, optimum, lost).axes
    path = lines(holds)["T_0, the optimum"]
    np.testing.assert_array_equal(path.get_xydata().T, [optimum["x"], optimum["y"]])
    assert "without dB/dq (S3)" in lines(printed)
    moments = [name for name in lines(printed) if name.startswith("(16), (17) after")]
    assert 1 <= len(moments) <= 3


def test_a_path_around_obstacles_has_a_panel_of_its_own(optimum, lost):
    path = Drawn(name="T_1", rows=np.array([[0.0, 3.0, 5.0], [0.0, 1.0, 5.0]]))
    around = Panel(heading="IV.C", drawn=[path], discs=[Disc(x=2.0, y=2.0, radius=0.5)])
    third = figure_4(optimum, optimum, lost, avoiding=[around]).axes[2]
    assert "T_1" in lines(third)
    assert len(third.patches) == 1
    controls = Panel(heading="IV.C", drawn=[Drawn(name="T_1", rows=np.ones((2, 9)))])
    assert len(figure_5(optimum, optimum, lost, avoiding=[controls]).axes) == 6


def test_controls_have_units(optimum, lost):
    axes = figure_5(optimum, optimum, lost).axes
    assert [one.get_ylabel() for one in axes[::2]] == ["u_1 = nu (m/s)", "u_2 = eta (rad/s)"]
    np.testing.assert_array_equal(axes[0].lines[0].get_ydata()[:-1], optimum["nu"])
