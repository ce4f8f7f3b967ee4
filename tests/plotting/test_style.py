"""Every picture of a solution: axes with units, runs that went wrong, no pyplot."""

import re
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from matplotlib.figure import Figure

import ann_dc
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
def test_the_title_carries_n_and_dt(car, diverged, picture):
    assert picture(car).get_suptitle().startswith("car: N = 9, dt = 0.1 s\nsettled, certified")
    title = picture(diverged).get_suptitle()
    assert re.match(r"car, .*S1.*: N = 9, dt = 0.1 s\nleft domain at tan", title)


@pytest.mark.parametrize("picture", PICTURES)
def test_network_time_is_never_read_as_seconds(car, diverged, picture):
    for figure in (picture(car), picture(diverged)):
        for axes in figure.axes:
            label = axes.get_xlabel()
            assert not re.search(r"\bs\b(?!\))", label)
            assert "network time" not in label or label in (
                plotting.style.FASTEST,
                plotting.style.UNSCALED,
            )


def test_no_unit_is_made_up():
    for module in Path(ann_dc.__file__).parent.rglob("*.py"):
        assert "(problem units)" not in module.read_text(encoding="utf-8"), module


def test_the_objective_has_the_unit_of_the_cost(car):
    problem = replace(car.problem, units={"cost": "kJ"})
    assert plotting.title(replace(car, problem=problem)).endswith("objective 398.6315 kJ")


@pytest.mark.parametrize(
    ("unit", "label"),
    [("m", "x (m)"), ("", "x"), ("1", "x (1)"), ("N*m", "x (N·m)"), ("m/s^2", "x (m/s²)"),
     ("kg^-1", "x (kg⁻¹)"), ("e^x", "x (e^x)"), ("%", "x (%)"), ("m_s", "x (m_s)")],
)  # fmt: skip
def test_a_unit_is_set_as_it_is_written(unit, label, tmp_path):
    assert plotting.with_unit("x", unit) == label
    figure = plotting.new_figure(2, 2)
    figure.subplots().set_xlabel(label)
    assert plotting.save(figure, tmp_path / "label.png").exists()


@pytest.mark.sampled(2)
@pytest.mark.parametrize("picture", PICTURES)
def test_a_diverged_run_is_drawn(diverged, picture, tmp_path):
    assert not diverged.status.settled
    path = plotting.save(picture(diverged), tmp_path / "picture.png")
    assert path.stat().st_size > 10_000


def test_pyplot_is_left_alone(car):
    plotting.trajectory(car)
    pyplot = sys.modules.get("matplotlib.pyplot")
    assert pyplot is None or not pyplot.get_fignums()
