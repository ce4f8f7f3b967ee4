"""The ladder's figure: a row a rung, single defects indented, failures in words."""

import pytest

import ann_dc
from ann_dc import plotting
from ann_dc.fidelity.level_comparison import Group, Measured

RUNGS = [
    Measured(name="ODE", group=Group.DIGITAL, error=1e-12, settling=1e-5),
    Measured(name="slew alone", group=Group.ALONE, error=1e-3, settling=2e-5),
    Measured(name="broken", group=Group.DIGITAL, why="it oscillates"),
]


@pytest.fixture(scope="module")
def drawn():
    return plotting.comparison(RUNGS, ann_dc.plants.car())


def test_every_rung_has_a_row_and_single_defects_are_indented(drawn):
    rows = [label.get_text() for label in drawn.axes[0].get_yticklabels()]
    assert rows == ["ODE", "  slew alone", "broken"]


def test_a_rung_that_failed_says_why(drawn):
    assert "it oscillates" in [text.get_text() for text in drawn.axes[0].texts]


def test_the_title_carries_n_and_dt(drawn):
    assert drawn.get_suptitle() == "car: N = 9, dt = 0.1 s, model levels"


def test_axes_have_units(drawn):
    assert all("(" in axes.get_xlabel() for axes in drawn.axes)
