"""The law of the Gilbert multiplier: sweeps of the shipped subcircuit find its coefficients."""

from functools import cache

import numpy as np
import pytest
from library_table import CIRCUITS
from multiplier_sweeps import Bench, found, known, reported
from simulator import needs_ngspice

from ann_dc.hardware.parts.transistors import GILBERT

SCALES = (0.5, 0.8, 1.25)
SHARES = np.linspace(-1.0, 1.0, 7)
ADDED = np.array([-0.4, 0.0, 0.4])
"""Volts of full scale, y over it, and z over it."""
LEVEL = CIRCUITS / "models" / "transistor"
BENCH = Bench(
    [(LEVEL / f"{name}.lib").read_text() for name in ("opamp", "mul4q")],
    "reltol=1e-6 vntol=1e-8",
    timeout=60,
)

pytestmark = needs_ngspice


@cache
def measured(volts: float):
    return BENCH.grid(volts, SHARES * volts, ADDED * volts)


@pytest.mark.slow
@pytest.mark.parametrize(
    "volts", [SCALES[0], *(pytest.param(volts, marks=pytest.mark.slow) for volts in SCALES[1:])]
)
def test_a_sweep_is_the_law(volts):
    x, y, z, out = sweep = measured(volts)
    assert np.abs(out - volts * x * y - z).max() > 2e-4
    assert np.abs(out - reported(GILBERT.at(volts), volts, sweep)).max() < 3e-5


@pytest.mark.sampled(2)
@pytest.mark.parametrize("gain", [0.1, 0.5, 2.0])
def test_multiplier_of_small_or_large_gain_follows_the_law(gain):
    """The law of gain 1 times the gain was 36 uV off at the corners, and 50 uV beside 1 V of z."""
    sweep = BENCH.grid(0.8, 0.8 * SHARES, np.array([-1.0, 0.4, 0.8]), gain=gain, reach=2.0)
    left = sweep[3] - reported(GILBERT.at(0.8, gain), 0.8, sweep, gain)
    assert np.abs(left).max() < 1.5e-5


@pytest.mark.sampled(1)
@pytest.mark.parametrize("volts", SCALES)
def test_a_sweep_finds_the_coefficients(volts):
    off = np.abs(found(volts, measured(volts)) - known(GILBERT.at(volts)))
    assert (off < [20e-6, 15e-6, 15e-6, 5e-6, 5e-6, 5e-6, 15e-6, 6e-6]).all(), off


def test_inputs_draw_a_current_and_outputs_have_a_resistance():
    amperes, ohms = BENCH.loaded()
    assert amperes == pytest.approx(GILBERT.input_current, rel=0.05)
    np.testing.assert_allclose(ohms, GILBERT.output_resistance, rtol=0.1)


def test_the_gain_does_not_hang_on_how_many_there_are():
    one = ["X1 a 0 a 0 0 o mul4q"]
    others = [f"X_{number} 0 0 0 0 0 o{number} mul4q" for number in range(150)]
    alone, together = (BENCH.ran(cards, ["o"]) for cards in (one, [*one, *others]))
    assert np.abs(alone - together).max() < 3e-5
