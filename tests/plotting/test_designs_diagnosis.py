"""The diagnosis' figure: spectrum and limit, rows beside their penalties, a panel a mode."""

import numpy as np
import pytest
from designs import designed

from ann_dc import diagnose, plants, plotting


@pytest.fixture(scope="module")
def found():
    return diagnose(designed("van_der_pol"))


@pytest.fixture(scope="module")
def drawn(found):
    return plotting.diagnosis(found)


def test_a_panel_for_spectrum_and_rows_and_one_a_mode(drawn, found):
    assert len(drawn.axes) == 2 + len(found.slowness.modes)
    assert [label.get_text() for label in drawn.axes[1].get_yticklabels()] == [
        row.neuron for row in found.slowness.rows
    ]


def test_the_limit_and_the_ratio_stand_in_the_spectrum(drawn, found):
    at = {line.get_label(): line.get_xdata() for line in drawn.axes[0].lines}
    np.testing.assert_allclose(at["limit: stiffness ratio 2"], 0.5)
    ratio = found.slowness.ratio
    np.testing.assert_allclose(at[f"ratio {ratio:.3g}"], 1 / ratio)
    numbers = [text.get_text() for text in drawn.axes[0].texts]
    assert numbers == [str(n + 1) for n in range(len(found.slowness.modes))]


def test_leading_neurons_are_named(drawn, found):
    for axes, mode in zip(drawn.axes[2:], found.slowness.modes):
        labels = [text.get_text() for text in axes.get_legend().get_texts()]
        assert labels[0].startswith(f"{mode.leading[0]}, ")
        assert mode.pattern in axes.get_title(loc="left")


def test_the_headline_says_why(drawn, found):
    assert found.reason in drawn.get_suptitle()


def test_the_title_carries_n_and_dt_where_the_problem_is_told(drawn, found):
    title = plotting.diagnosis(found, plants.van_der_pol()).get_suptitle()
    assert title.startswith("van_der_pol: N = 40, dt = 0.1; ratio ")
    assert drawn.get_suptitle().startswith("van_der_pol; ratio ")


def test_axes_have_units(drawn):
    for axes in drawn.axes:
        assert "(" in axes.get_xlabel() or not axes.get_xlabel()
    assert all("(" in axes.get_ylabel() for axes in drawn.axes[:1] + drawn.axes[2:])


@pytest.mark.slow
def test_same_figure_same_bytes(found, tmp_path):
    files = [
        plotting.save(plotting.diagnosis(found), tmp_path / name) for name in ("one.png", "two.png")
    ]
    assert files[0].read_bytes() == files[1].read_bytes()
