"""The picture of a family: shares over time, inputs with their units, failing ones as crosses."""

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.colors import same_color

import ann_dc
from ann_dc import plotting
from ann_dc.families.family_design import Failure, FamilyDesign, design_family

OVER = {"q_d.x": (0.5, 2.0), "q_0.v": (-0.5, 0.5)}


@pytest.fixture(scope="module")
def masses() -> FamilyDesign:
    return design_family(ann_dc.plants.double_integrator(N=5), OVER, held_out=20)


def failing(designed: FamilyDesign, numbers: list[int]) -> FamilyDesign:
    found = designed.validation
    settling, certified = found.settling.copy(), found.certified.copy()
    settling[numbers], certified[numbers] = np.inf, False
    failures = dict.fromkeys(numbers, Failure.SLOW)
    return replace(
        designed,
        validation=replace(found, settling=settling, certified=certified, failures=failures),
    )


def crosses(axes):
    return next(
        line for line in axes.lines if same_color(line.get_color(), plotting.style.VERMILION)
    )


@pytest.mark.slow
def test_axes_have_the_units_of_their_states(masses):
    shares, plane = plotting.family(masses).axes[:2]
    assert shares.get_xlabel() == plotting.style.FASTEST
    assert (plane.get_xlabel(), plane.get_ylabel()) == ("q_d.x (m)", "q_0.v (m/s)")


@pytest.mark.slow
def test_every_input_is_drawn_where_it_lies(masses):
    plane = plotting.family(masses).axes[1]
    drawn = plane.collections[0]
    given = [(s["q_d.x"][0], s["q_0.v"][0]) for s in masses.validation.samples]
    np.testing.assert_allclose(drawn.get_offsets(), given)
    np.testing.assert_allclose(drawn.get_array(), masses.validation.settling)
    assert len(crosses(plane).get_xdata()) == 0


@pytest.mark.slow
def test_inputs_that_fail_are_crosses_and_lower_the_share(masses):
    numbers = [3, 8, 11]
    figure = plotting.family(failing(masses, numbers))
    shares, plane = figure.axes[:2]
    marked = crosses(plane)
    for name, data in (("q_d.x", marked.get_xdata()), ("q_0.v", marked.get_ydata())):
        samples = masses.validation.samples
        np.testing.assert_allclose(data, [samples[number][name][0] for number in numbers])
    assert len(plane.collections[0].get_offsets()) == 17
    assert shares.lines[0].get_ydata()[-1] == pytest.approx(17 / 20)
    assert "85.0% of 20 held-out inputs" in figure.get_suptitle()


@pytest.mark.slow
def test_where_all_fail_there_is_a_picture_all_the_same(masses):
    figure = plotting.family(failing(masses, list(range(20))))
    assert len(crosses(figure.axes[1]).get_xdata()) == 20
    assert "0.0% of 20" in figure.get_suptitle()


@pytest.mark.slow
def test_one_input_alone_is_drawn_over_itself():
    problem = ann_dc.plants.double_integrator(N=5)
    plane = plotting.family(design_family(problem, {"q_d.x": (0.5, 2.0)}, held_out=5)).axes[1]
    assert plane.get_xlabel() == plane.get_ylabel() == "q_d.x (m)"


@pytest.mark.slow
def test_four_inputs_are_two_planes():
    over = {f"{end}.{s}": (0.9, 1.1) for end in ("q_0", "q_d") for s in ("x", "v")}
    problem = ann_dc.plants.double_integrator(N=5)
    axes = plotting.family(design_family(problem, over, held_out=5)).axes
    assert [a.get_xlabel() for a in axes[1:3]] == ["q_0.x (m)", "q_d.x (m)"]
    assert [a.get_ylabel() for a in axes[1:3]] == ["q_0.v (m/s)", "q_d.v (m/s)"]
