"""Panels of Figures 4 and 5 with obstacles."""

from functools import cache

import numpy as np
import pytest
from closed_chains import CAR, closed_chain

from ann_dc.paper import CASES, driven, replanned
from ann_dc.plotting.paper import controls_around, path_around


@cache
def planned():
    return replanned(closed_chain(CAR), CAR, CASES[1])


@pytest.mark.slow
def test_a_leap_leads_from_one_piece_to_the_next():
    panel, pieces = path_around(planned()), driven(planned())
    assert panel.heading == "(b) three obstacles"
    assert len(panel.discs) == 3
    without, pieced, leaps = (drawn.rows for drawn in panel.drawn)
    np.testing.assert_array_equal(without, planned().states[0, :2])
    assert np.isnan(pieced[0]).sum() == 3
    assert np.isnan(leaps[0]).sum() == 2
    np.testing.assert_array_equal(leaps[:, 0], pieces[0].q[:2, -1])
    np.testing.assert_array_equal(leaps[:, 1], planned().states[1, :2, 0])


@pytest.mark.slow
def test_controls_have_a_gap_where_it_leaps():
    _, pieced = (drawn.rows for drawn in controls_around(planned()).drawn)
    stages = sum(piece.u.shape[1] for piece in driven(planned()))
    assert pieced.shape == (2, stages + 3)
    assert np.isnan(pieced[0]).sum() == 3
