"""How a network settled, beside the prediction."""

from dataclasses import replace

import numpy as np
import pytest

from ann_dc import plotting


def residual_panel(solution):
    return plotting.settling(solution).axes[1]


def with_residuals(solution, residuals):
    trajectory = replace(solution.trajectory, residuals=residuals)
    return replace(solution, run=replace(solution.run, trajectory=trajectory))


def test_prediction_and_settling_time_are_drawn(car):
    labels = residual_panel(car).get_legend_handles_labels()[1]
    assert f"settled after {car.normalised_settling_time:.3g}" in labels
    assert f"predicted: falls by e in {car.spectrum.stiffness_ratio:.3g}" in labels


def test_time_is_counted_in_fastest_time_constants(car):
    axes = residual_panel(car)
    assert axes.get_xlabel() == "network time (tau_min)"
    assert axes.get_xlim()[1] == pytest.approx(car.trajectory.time[-1] * car.spectrum.radius)
    marked = next(line for line in axes.lines if line.get_label().startswith("settled"))
    assert marked.get_xdata()[0] == pytest.approx(car.normalised_settling_time)


def test_without_a_spectrum_time_stays_as_the_network_counts_it(diverged):
    axes = residual_panel(diverged)
    assert axes.get_xlabel() == "network time (unit time constants)"
    assert axes.get_xlim()[1] == pytest.approx(diverged.trajectory.time[-1])


@pytest.mark.parametrize("decades", [0, 3, 9, 30])
def test_the_first_instant_gets_no_decades(car, decades):
    """However large a residual is before one fastest time constant has passed."""
    plain = residual_panel(car).get_ylim()
    first = car.trajectory.residual_time * car.spectrum.radius < 1
    assert 0 < first.sum() < len(first) / 2
    raised = np.where(first[:, None], 10.0**decades, 1) * car.trajectory.residuals
    axes = residual_panel(with_residuals(car, raised))
    assert axes.get_ylim() == pytest.approx(plain)
    assert [text.get_text() for text in axes.texts] == [f"from {raised[0].max():.0e}"]


def test_what_lasts_is_shown(car):
    lasting = 1e8 * car.trajectory.residuals
    axes = residual_panel(with_residuals(car, lasting))
    later = car.trajectory.residual_time * car.spectrum.radius >= 1
    assert axes.get_ylim()[1] > lasting[later].max()
