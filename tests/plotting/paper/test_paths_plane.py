"""Figure 4 from plain numbers: paths, discs, ends."""

import numpy as np
import pytest
from matplotlib.patches import Circle

from ann_dc.errors import ArgumentError
from ann_dc.plotting.paper.paths import Disc, Drawn, Panel, plane

ROWS = np.array([[0.0, 1.0, 5.0], [0.0, 2.0, 5.0]])
DISCS = (Disc(x=2.0, y=1.0, radius=0.5), Disc(x=3.0, y=4.0, radius=0.25))
ENDS = {"start": (0.0, 0.0), "target": (5.0, 5.0)}


def drawn():
    path, led = Drawn(name="T_1", rows=ROWS), Drawn(name="led", rows=ROWS + 0.1, dashed=True)
    panels = [
        Panel(heading="free", drawn=[path, led]),
        Panel(heading="around", drawn=[path], discs=DISCS),
    ]
    return plane(panels, **ENDS, title="Figure 4")


def test_every_panel_has_its_paths_and_discs():
    free, around = drawn().axes
    assert not [patch for patch in free.patches if isinstance(patch, Circle)]
    circles = [patch for patch in around.patches if isinstance(patch, Circle)]
    assert [(c.center, c.radius) for c in circles] == [((2.0, 1.0), 0.5), ((3.0, 4.0), 0.25)]
    lines = {line.get_label(): line for line in free.lines}
    np.testing.assert_array_equal(lines["T_1"].get_xydata().T, ROWS)
    np.testing.assert_array_equal(lines["led"].get_xydata().T, ROWS + 0.1)
    assert lines["led"].get_linestyle() == "--"


def test_axes_have_units_and_one_scale():
    for axes in drawn().axes:
        assert axes.get_xlabel() == "x (m)"
        assert axes.get_aspect() == 1.0
    assert drawn().axes[0].get_ylabel() == "y (m)"


def test_the_legend_names_everything_once():
    (legend,) = drawn().legends
    names = [text.get_text() for text in legend.get_texts()]
    assert sorted(names) == ["T_1", "initial state q_0", "led", "obstacle", "terminal state q_d"]


def test_what_is_lost_is_left_out():
    figure = plane([Panel(heading="", drawn=[Drawn(name="lost", rows=ROWS * 1e200)])], **ENDS)
    line = next(line for line in figure.axes[0].lines if line.get_label() == "lost")
    assert np.isnan(line.get_xydata()[1:]).all()


@pytest.mark.parametrize("radius", [0.0, -1.0, np.nan])
def test_a_disc_has_a_radius(radius):
    with pytest.raises(ArgumentError, match="radius"):
        Disc(x=0.0, y=0.0, radius=radius)
