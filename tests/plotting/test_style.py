"""Every picture of a solution: axes with units, runs that went wrong, no pyplot."""

import sys

import pytest
from matplotlib.figure import Figure

from ann_dc import plotting

PICTURES = (plotting.trajectory, plotting.controls, plotting.settling, plotting.spectrum)


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


@pytest.mark.parametrize("picture", PICTURES)
def test_a_diverged_run_is_drawn(diverged, picture, tmp_path):
    assert not diverged.status.settled
    path = plotting.save(picture(diverged), tmp_path / "picture.png")
    assert path.stat().st_size > 10_000


def test_pyplot_is_left_alone(car):
    plotting.trajectory(car)
    pyplot = sys.modules.get("matplotlib.pyplot")
    assert pyplot is None or not pyplot.get_fignums()
