"""Figures 1 to 3 of the paper, for the problem at hand."""

from matplotlib.patches import Polygon

from ann_dc.plotting.paper.schemes import figure_1, figure_2, figure_3
from ann_dc.problem import plants


def texts(figure) -> str:
    return " ".join(text.get_text() for axes in figure.axes for text in axes.texts)


def test_robot_has_four_wheels_and_its_coordinates():
    figure = figure_1(D=0.5)
    wheels = [patch for patch in figure.axes[0].patches if isinstance(patch, Polygon)]
    assert len(wheels) == 4
    for name in ("(x, y)", "phi", "varphi", "nu", "eta", "D = 0.5 m"):
        assert name in texts(figure)


def test_decomposition_names_the_stages_and_the_end_of_the_problem():
    assert "t_{8}" in texts(figure_2(plants.car()))
    assert "q_d" in texts(figure_2(plants.car()))
    assert "free terminal state" in texts(figure_2(plants.car(q_d=None)))


def test_transfer_tells_the_first_stage_no_beta_if_its_state_is_given():
    reported = texts(figure_3(plants.double_integrator(N=4)))
    assert "$t_0$" in reported
    assert "beta_{3}" in reported
