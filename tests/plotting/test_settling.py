"""How a network settled, beside the prediction."""

from ann_dc import plotting


def test_prediction_and_settling_time_are_drawn(car):
    labels = plotting.settling(car).axes[1].get_legend_handles_labels()[1]
    assert f"settled at s = {car.settling_time:.4g}" in labels
    assert f"predicted exp({car.spectrum.abscissa:.3g} s)" in labels
