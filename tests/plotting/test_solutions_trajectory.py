"""The plan in the plane, and states over time."""

from dataclasses import replace

import pytest
import sympy as sp

import ann_dc
from ann_dc import plotting


def test_units_of_the_problem_stand_on_the_axes(car):
    axes = plotting.trajectory(car).axes
    assert axes[0].get_xlabel() == "x (m)"
    assert [a.get_ylabel() for a in axes] == [
        "y (m)", "x\n(m)", "y\n(m)", "phi\n(rad)", "varphi\n(rad)",
    ]  # fmt: skip
    assert axes[-1].get_xlabel() == "time k dt (s)"


def test_what_has_no_unit_is_drawn_by_its_name(car):
    bare = replace(car, problem=replace(car.problem, units={"y": "m"}))
    labels = [axes.get_ylabel() for axes in plotting.trajectory(bare).axes]
    assert labels == ["y (m)", "x", "y\n(m)", "phi", "varphi"]


def test_a_plane_is_a_map_only_in_one_unit(car):
    assert plotting.trajectory(car).axes[0].get_aspect() == 1
    mixed = replace(car.problem, units={"x": "km", "y": "m"})
    figure = plotting.trajectory(replace(car, problem=mixed))
    assert figure.axes[0].get_aspect() == "auto"
    assert "heading phi" not in [text.get_text() for text in figure.legends[0].get_texts()]


def test_plane_needs_two_states():
    x, u = sp.symbols("x u")
    problem = ann_dc.OptimalControlProblem(
        states=(x,), controls=(u,), map=(x + u,), cost=u**2, horizon=4, q_0=(0,), q_d=(1,)
    )
    solution = ann_dc.solve(problem, backend=ann_dc.OdeBackend(verify=False))
    assert len(plotting.trajectory(solution).axes) == 1
    assert len(plotting.controls(solution).axes) == 1


@pytest.mark.slow
def test_what_inequalities_of_the_plane_forbid_is_grey(held):
    """v <= 2 x + 0.4 and the bounds of v are; x <= w, of an input, is not."""
    figure = plotting.trajectory(held)
    figure.draw_without_rendering()
    plane = figure.axes[0]
    (left, right), (low, high) = plane.get_xlim(), plane.get_ylim()
    assert -0.5 < left < right < 1.5
    assert -0.5 < low < high < 1
    (grey,) = plane.collections
    (path,) = grey.get_paths()
    assert path.contains_point((0.5, 0.7))
    assert path.contains_point((left + 0.02, 0.5))
    assert not path.contains_point((0.5, 0.5))
    assert "forbidden" in [text.get_text() for text in figure.legends[0].get_texts()]


def test_where_nothing_is_forbidden_nothing_is_grey(car):
    plane = plotting.trajectory(car).axes[0]
    assert len(plane.collections) == 1  # the headings
