"""Controls over time."""

from dataclasses import replace

import pytest
import sympy as sp

import ann_dc
from ann_dc import plotting


def test_time_axis_is_in_seconds(car):
    figure = plotting.controls(car)
    assert figure.axes[-1].get_xlabel() == "time k dt (s)"
    assert figure.axes[-1].get_xlim() == pytest.approx((0.0, 0.9))


def test_units_are_the_problems(car):
    labels = [axes.get_ylabel() for axes in plotting.controls(car).axes]
    assert labels == ["nu (m/s)", "eta (rad/s)"]
    other = replace(car, problem=replace(car.problem, units={"nu": "km/h", "time": "day"}))
    axes = plotting.controls(other).axes
    assert [a.get_ylabel() for a in axes] == ["nu (km/h)", "eta"]
    assert axes[-1].get_xlabel() == "time k dt (day)"


def test_the_axis_of_time_is_that_of_the_steps_that_were_chosen():
    h = sp.Symbol("h")
    given = ann_dc.plants.double_integrator(N=5)
    problem = replace(given, dt=ann_dc.StepLength(low=0.1, high=1.0), cost=h * (1 + given.cost))
    solution = ann_dc.solve(problem, backend=ann_dc.OdeBackend(verify=False))
    (controls,), states = plotting.controls(solution).axes, plotting.trajectory(solution).axes
    assert controls.get_xlim()[1] == pytest.approx(solution.total_time)
    assert [axes.get_ylabel() for axes in states[1:]] == ["x\n(m)", "v\n(m/s)"]
    assert f"N = 5, dt = {solution.step_length:.4g} s, chosen" in controls.figure.get_suptitle()
    record = solution.as_dict()
    assert (record["dt"], record["total_time"]) == (solution.step_length, solution.total_time)


def lines_across(axes):
    """Heights of the dashed lines of bounds."""
    return [line.get_ydata()[0] for line in axes.lines if line.get_label() == "bound"]


@pytest.mark.slow
def test_bounds_are_dashed_where_they_are_near(held):
    figure = plotting.controls(held)
    assert lines_across(figure.axes[0]) == [-5, 2]
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["bound"]
    _, x, v = plotting.trajectory(held).axes
    assert (lines_across(x), lines_across(v)) == ([], [0.65])


def test_what_has_no_bounds_has_no_legend(car):
    assert plotting.controls(car).legends == []
