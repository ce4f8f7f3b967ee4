"""Figure 5 from plain numbers: controls are held from stage to stage."""

import numpy as np

from ann_dc.plotting.paper.paths import Drawn, Panel, controls_over_stages

ROWS = np.array([[4.0, 8.0, 6.0], [1.0, -1.0, 0.0]])
LABELS = ["u_1 (m/s)", "u_2 (rad/s)"]


def drawn():
    panels = [
        Panel(heading="holds", drawn=[Drawn(name="T_0", rows=ROWS)]),
        Panel(heading="printed", drawn=[Drawn(name="lost", rows=100 * ROWS)]),
    ]
    return controls_over_stages(panels, labels=LABELS)


def test_a_control_holds_until_the_next():
    line = drawn().axes[0].lines[0]
    np.testing.assert_array_equal(line.get_xdata(), [0, 1, 2, 3])
    np.testing.assert_array_equal(line.get_ydata(), [4, 8, 6, 6])
    assert line.get_drawstyle() == "steps-post"


def test_what_runs_away_does_not_hide_the_rest():
    first, other = drawn().axes[:2]
    low, high = first.get_ylim()
    assert other.get_ylim() == (2 * low - high, 2 * high - low)


def test_axes_have_units():
    axes = drawn().axes
    assert [one.get_ylabel() for one in axes[::2]] == LABELS
    assert all(one.get_xlabel() == "stage k" for one in axes[2:])
