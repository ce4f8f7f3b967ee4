"""Settings of levels and technologies are checked, and named."""

from dataclasses import replace

import numpy as np
import pytest

from ann_dc.errors import NetworkError
from ann_dc.hardware.parts import (
    Datasheet,
    Level,
    Parasitics,
    board_parameters,
    macro,
    ota_c,
    switched_capacitor,
)


@pytest.mark.parametrize(
    ("make", "field"),
    [
        (lambda: ota_c(linear_range=0.0), "linear_range"),
        (lambda: ota_c(linear_range=np.nan), "linear_range"),
        (lambda: switched_capacitor(step=0.0), "step"),
        (lambda: switched_capacitor(step=np.nan), "step"),
        (lambda: switched_capacitor(step=0.1, clock=-1e6), "clock"),
        (lambda: switched_capacitor(step=0.1, unit_capacitor=0.0), "unit_capacitor"),
        (lambda: switched_capacitor(step=0.1, overlap=-1e-15), "overlap"),
        (lambda: replace(macro(), smallest_resistor=0.0), "smallest_resistor"),
        (lambda: replace(macro(), smallest_capacitor=-1e-12), "smallest_capacitor"),
        (lambda: replace(macro(), smallest_capacitor=np.inf), "smallest_capacitor"),
    ],
)
def test_a_setting_out_of_range_is_named(make, field):
    with pytest.raises(NetworkError, match=f"^{field}: expected"):
        make()


ON_BOARDS = {
    "opamp_cin": {"input_capacitance": 2e-12, "stray_capacitance": 1e-12},
    "opamp_ib": {"bias_current": 3e-12},
    "opamp_pole2": {"second_pole": 3e-12},
    "opamp_imax": {"output_current": 3e-12},
}


@pytest.mark.parametrize("parameter", ON_BOARDS)
def test_every_parasitic_of_op_amps_is_a_parameter_of_their_models(parameter):
    parts = Parasitics(**ON_BOARDS[parameter])
    level = macro(Datasheet(parasitics=parts))
    assert level.on_board
    assert level.parameters[parameter] == pytest.approx(3e-12)
    others = board_parameters(Parasitics(bias_current=1e-30))
    for name in others.keys() - {parameter, "opamp_ib"}:
        assert level.parameters[name] == others[name]


def test_levels_without_parasitics_of_op_amps_have_the_parameters_that_they_had():
    plain = macro()
    other = macro(Datasheet(a0=1e6, parasitics=Parasitics(multiplier_noise=1e-6)))
    assert not plain.on_board
    assert plain.parameters == other.parameters
    assert "opamp_cin" not in plain.parameters
    biased = Datasheet(parasitics=Parasitics(bias_current=1e-9))
    assert not Level(name="ideal", models="ideal", datasheet=biased).on_board
