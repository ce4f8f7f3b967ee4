"""The law of the multiplier of SKY130 devices: sweeps of the shipped subcircuit find it again."""

from functools import cache

import numpy as np
import pytest
from library_table import CIRCUITS
from multiplier_sweeps import Bench, found, known, reported
from simulator import needs_ngspice
from small_pdk import needs_pdk

from ann_dc.backends.spice.pdk.place import place_of
from ann_dc.hardware.parts.foundry import SKY130

LAW = SKY130.datasheet.multiplier_law
SHARES = np.linspace(-1.0, 1.0, 5)
ADDED = np.array([-0.3, 0.0, 0.3])
"""Of 1 V: y, and what is added to the output."""
SCALES = ((0.8, 1.0), (1.0, 1.0), (1.0, 0.5), (1.2, 0.4))
"""Volts of full scale, and 1 + ge."""

pytestmark = [needs_ngspice, needs_pdk, pytest.mark.slow]


@cache
def bench() -> Bench:
    folder = CIRCUITS / "models" / "sky130"
    library = {name: (folder / f"{name}.lib").read_text() for name in ("opamp", "mul4q")}
    place = place_of(SKY130, library)
    models = [*place.before, *library.values(), *place.behind]
    return Bench(models, f"{place.options} vntol=1e-7 reltol=1e-4", timeout=300)


@cache
def measured(volts: float, gain: float):
    """The inputs up to 1 V."""
    return bench().grid(volts, SHARES * min(volts, 1.0), ADDED, gain=gain)


@pytest.mark.parametrize(("volts", "gain"), SCALES)
def test_a_sweep_is_the_law(volts, gain):
    x, y, z, out = sweep = measured(volts, gain)
    off, left = (
        out - gain * volts * x * y - z,
        out - reported(LAW.at(volts, gain), volts, sweep, gain),
    )
    assert np.linalg.norm(left) < 0.25 * np.linalg.norm(off)
    assert np.abs(left).max() < 5e-4


@pytest.mark.parametrize("volts", [volts for volts, gain in SCALES if gain == 1.0])
def test_a_sweep_finds_the_coefficients(volts):
    off = np.abs(found(volts, measured(volts, 1.0)) - known(LAW.at(volts)))
    assert (off < [120e-6, 90e-6, 60e-6, 20e-6, 20e-6, 20e-6, 70e-6, 20e-6]).all(), off


def test_inputs_draw_a_current_and_outputs_have_a_resistance():
    amperes, ohms = bench().loaded()
    assert amperes == pytest.approx(LAW.input_current, rel=0.1)
    np.testing.assert_allclose(ohms, LAW.output_resistance, rtol=0.1)
