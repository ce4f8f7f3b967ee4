"""Figures 4 and 5: the ways around the obstacles of a case, as pictures."""

from functools import cache

import numpy as np
import pytest
from closed_chains import CAR, closed_chain
from matplotlib.patches import Circle

from ann_dc.paper.around import around
from ann_dc.paper.replans import CASES, replanned
from ann_dc.plotting.paper.paths import figure_4, figure_5


@cache
def planned():
    return around(replanned(closed_chain(CAR), CAR, CASES[1]), CAR)


def lines(axes):
    return {line.get_label(): line for line in axes.lines}


@pytest.mark.slow
def test_a_leap_leads_from_one_piece_to_the_next():
    printed, segments, discs = figure_4([planned()]).axes
    pieces = planned().printed
    assert printed.get_title(loc="left").startswith("(b) three obstacles, as printed")
    for axes in (printed, segments, discs):
        assert len([patch for patch in axes.patches if isinstance(patch, Circle)]) == 3
    leaps = lines(printed)["to q_obs + delta (printed without a plan)"].get_xydata()
    np.testing.assert_array_equal(leaps[0], pieces[0].q[:2, -1])
    np.testing.assert_array_equal(leaps[1], pieces[1].q[:2, 0])
    path = lines(discs)["one network, obstacles as constraints"].get_xydata()
    np.testing.assert_array_equal(path, planned().ways["discs"].q[:2].T)


@pytest.mark.slow
def test_controls_have_gaps_only_as_printed():
    axes = figure_5([planned()]).axes
    assert len(axes) == 6
    first, driven, constrained = axes[:3]
    names = "T_0, T_1, ... (executed parts, IV.C)", "executed plans and segments"
    assert np.isnan(lines(first)[names[0]].get_ydata().astype(float)).sum() >= 3
    whole = lines(driven)[names[1]].get_ydata()
    np.testing.assert_array_equal(whole[:-1], planned().ways["with segments"].u[0])
    assert np.isfinite(whole).all()
    assert "one network, obstacles as constraints" in lines(constrained)
