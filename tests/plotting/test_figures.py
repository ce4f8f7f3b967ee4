"""The four pictures: axes with units, honest errors, same bytes, and runs that went wrong."""

from dataclasses import replace

import numpy as np
import pytest
import sympy as sp
from matplotlib.figure import Figure

import ann_dc
from ann_dc import plotting
from ann_dc.errors import OutputError

PICTURES = (plotting.trajectory, plotting.controls, plotting.settling, plotting.spectrum)


@pytest.fixture(scope="module")
def car():
    return ann_dc.solve(ann_dc.plants.car(), backend=ann_dc.OdeBackend(verify=False))


@pytest.fixture(scope="module")
def diverged():
    return ann_dc.solve(
        ann_dc.plants.car(), form=ann_dc.switch("S1"), backend=ann_dc.OdeBackend(verify=False)
    )


@pytest.mark.parametrize("picture", PICTURES)
def test_axes_are_labelled_with_units(car, picture):
    figure = picture(car)
    assert isinstance(figure, Figure)
    for axes in figure.axes:
        assert axes.get_ylabel()
        assert "(" in axes.get_ylabel()
    bottom = [axes for axes in figure.axes if axes.get_xlabel()]
    assert bottom
    assert all("(" in axes.get_xlabel() for axes in bottom)


def test_units_given_stand_on_the_axes(car):
    labels = [axes.get_ylabel() for axes in plotting.trajectory(car, {"y": "m"}).axes]
    assert labels[0] == "y (m)"
    assert labels[-1] == "varphi\n(problem units)"


def test_time_axis_is_in_seconds(car):
    figure = plotting.controls(car)
    assert figure.axes[-1].get_xlabel() == "time k dt (s)"
    assert figure.axes[-1].get_xlim() == pytest.approx((0.0, 0.9))


def test_prediction_and_settling_time_are_drawn(car):
    labels = plotting.settling(car).axes[1].get_legend_handles_labels()[1]
    assert f"settled at s = {car.settling_time:.4g}" in labels
    assert f"predicted exp({car.spectrum.abscissa:.3g} s)" in labels


def test_plane_needs_two_states():
    x, u = sp.symbols("x u")
    problem = ann_dc.OptimalControlProblem(
        states=(x,), controls=(u,), map=(x + u,), cost=u**2, horizon=4, q_0=(0,), q_d=(1,)
    )
    solution = ann_dc.solve(problem, backend=ann_dc.OdeBackend(verify=False))
    assert len(plotting.trajectory(solution).axes) == 1
    assert len(plotting.controls(solution).axes) == 1


@pytest.mark.parametrize("picture", PICTURES)
def test_a_diverged_run_is_drawn(diverged, picture, tmp_path):
    assert not diverged.status.settled
    path = plotting.save(picture(diverged), tmp_path / "picture.png")
    assert path.stat().st_size > 10_000


def test_states_that_are_not_finite_are_left_out(car, tmp_path):
    states = car.trajectory.states.copy()
    states[-1] = np.nan
    states[-2, 0] = np.inf
    residuals = car.trajectory.residuals.copy()
    residuals[-1] = np.inf
    trajectory = replace(car.trajectory, states=states, residuals=residuals)
    lost = replace(car, run=replace(car.run, trajectory=trajectory))
    assert len(plotting.save_all(lost, tmp_path)) == 4


def test_save_all_names_creates_and_repeats_the_bytes(car, tmp_path):
    first = plotting.save_all(car, tmp_path / "a" / "b")
    again = plotting.save_all(car, str(tmp_path / "c"))
    assert [path.name for path in first] == [
        "trajectory.png",
        "controls.png",
        "settling.png",
        "spectrum.png",
    ]
    assert [p.read_bytes() for p in first] == [p.read_bytes() for p in again]


@pytest.mark.parametrize("inside", ["", "deeper"])
def test_a_folder_that_is_a_file_is_an_error(car, tmp_path, inside):
    taken = tmp_path / "taken"
    taken.write_text("not a folder")
    with pytest.raises(OutputError, match=r"taken.*a file stands where.*give a path in"):
        plotting.save_all(car, taken / inside)


def test_pyplot_is_left_alone(car):
    import sys

    plotting.trajectory(car)
    pyplot = sys.modules.get("matplotlib.pyplot")
    assert pyplot is None or not pyplot.get_fignums()
