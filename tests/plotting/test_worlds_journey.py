"""A journey's picture shows what was there and what happened."""

from dataclasses import replace

import numpy as np
from journeys import a_journey
from matplotlib.patches import Circle, Polygon

from ann_dc.plotting.worlds import journey as picture


def test_the_plane_shows_obstacles_way_and_ends():
    driven = a_journey()
    figure = picture(driven)
    plane, room, relative_multiplier, residual = figure.axes
    drawn = [patch for patch in plane.patches if patch.get_facecolor()[3] > 0]
    assert sum(isinstance(patch, Polygon) for patch in drawn) == 1
    discs = [patch for patch in drawn if isinstance(patch, Circle)]
    np.testing.assert_allclose(
        discs[0].center,
        driven.world.obstacles[0].centres(np.array([driven.dt * driven.u.shape[1]]))[0],
    )
    ways = {line.get_label(): line.get_xydata() for line in plane.lines}
    np.testing.assert_array_equal(ways["path of the robot"], driven.q[:2].T)
    assert {"start", "goal", "plans"} <= ways.keys()
    assert room.get_ylabel() == "clearance (m)"
    np.testing.assert_allclose(relative_multiplier.lines[0].get_ydata(), driven.relative_multiplier)
    assert residual.get_yscale() == "log"


def test_journey_without_residuals_has_no_empty_panels():
    """The waypoint planner runs no network."""
    driven = a_journey()
    figure = picture(replace(driven, residuals=np.zeros_like(driven.residuals)))
    assert [axes.get_ylabel() for axes in figure.axes] == ["y (m)", "clearance (m)"]
    assert figure.axes[1].get_xlabel() == "time (s)"
