"""The law of the multiplier of SKY130 devices: sweeps of the shipped subcircuit find it again."""

from functools import cache

import numpy as np
import pytest
from library_table import CIRCUITS
from simulator import needs_ngspice
from small_pdk import needs_pdk

from ann_dc.backends.spice.ngspice import Ngspice
from ann_dc.backends.spice.pdk import place_of
from ann_dc.hardware.parts import SKY130

LAW = SKY130.datasheet.multiplier_law
SHARES = np.linspace(-1.0, 1.0, 5)
ADDED = (-0.3, 0.0, 0.3)
"""Of 1 V: y, and what is added to the output."""
SCALES = ((0.8, 1.0), (1.0, 1.0), (1.0, 0.5), (1.2, 0.4))
"""Volts of full scale, and 1 + ge."""

pytestmark = [needs_ngspice, needs_pdk, pytest.mark.slow]


def ran(cards: list[str], nodes: list[str]) -> np.ndarray:
    """(nodes, 21) volts while v(a) goes from -1 V to 1 V."""
    folder = CIRCUITS / "models" / "sky130"
    library = {name: (folder / f"{name}.lib").read_text() for name in ("opamp", "mul4q")}
    place = place_of(SKY130, library)
    saved = ".save " + "\n+ ".join(f"v({node})" for node in nodes)
    ends = [".dc Va -1 1 0.1", f".options {place.options} vntol=1e-7 reltol=1e-4", saved, ".end\n"]
    models = [*place.before, *library.values(), *place.behind]
    raw = Ngspice(timeout=300).run("\n".join(["* sweep", *models, "Va a 0 0", *cards, *ends]))
    return np.array([np.real(raw[node]) for node in nodes])


@cache
def measured(volts: float, gain: float) -> tuple[np.ndarray, ...]:
    """(x, y, z, out), the inputs up to 1 V and over full scale, the output within it."""
    cards, nodes, at = [f"E1 x 0 a 0 {min(volts, 1.0)}"], [], []
    for i, y in enumerate(SHARES * min(volts, 1.0)):
        for j, z in enumerate(ADDED):
            cards += [f"Vy{i}_{j} y{i}_{j} 0 {y:.9g}", f"Vz{i}_{j} z{i}_{j} 0 {z:.9g}"]
            cards += [f"X{i}_{j} x 0 y{i}_{j} 0 z{i}_{j} o{i}_{j} mul4q vm={volts} ge={gain - 1}"]
            nodes.append(f"o{i}_{j}")
            at.append((y, z))
    out = ran(cards, nodes)
    x = np.linspace(-1.0, 1.0, out.shape[1]) * min(volts, 1.0)
    y, z = (np.array(at).T[k][:, None] + 0 * out for k in (0, 1))
    within = np.abs(out) <= 1.05 * volts
    return tuple(part[within] for part in ((x + 0 * out) / volts, y / volts, z, out))


@pytest.mark.parametrize(("volts", "gain"), SCALES)
def test_a_sweep_is_the_law(volts, gain):
    x, y, z, out = measured(volts, gain)
    product, law = gain * volts * x * y, LAW.at(volts, gain)
    slope = law.gain[0] + law.gain_y[0] + law.bend_x[0] * x**2 + law.bend_y[0] * y**2
    slope = slope + volts * (law.tilt_x * x + law.tilt_y * y)
    told = product * (1 + slope) + (1 + law.follow[0]) * z + law.offset[0] + law.bow * out**2
    off, left = out - product - z, out - told
    assert np.linalg.norm(left) < 0.25 * np.linalg.norm(off)
    assert np.abs(left).max() < 5e-4


@pytest.mark.parametrize("volts", [volts for volts, gain in SCALES if gain == 1.0])
def test_a_sweep_finds_the_coefficients(volts):
    x, y, z, out = measured(volts, 1.0)
    t, law = volts * x * y, LAW.at(volts)
    terms = [t, t * x**2, t * y**2, z, t * x * volts, t * y * volts, out**2, np.ones_like(t)]
    found = np.linalg.lstsq(np.array(terms).T, out - t - z, rcond=None)[0]
    known = [law.gain[0] + law.gain_y[0], law.bend_x[0], law.bend_y[0], law.follow[0]]
    known += [law.tilt_x, law.tilt_y, law.bow, law.offset[0]]
    off = np.abs(found - known)
    assert (off < [120e-6, 90e-6, 60e-6, 20e-6, 20e-6, 20e-6, 70e-6, 20e-6]).all(), off


def test_inputs_draw_a_current_and_outputs_have_a_resistance():
    cards = ["V1 one 0 1", "R1 a x 10k", "X1 x 0 one 0 0 o mul4q"]
    cards += ["X2 a 0 one 0 0 p mul4q", "X3 a 0 one 0 0 q mul4q", "R2 q 0 50k"]
    a, x, p, q = ran(cards, ["a", "x", "p", "q"])
    amperes = np.interp(0.0, a, (a - x) / 10e3)
    assert amperes == pytest.approx(LAW.input_current, rel=0.1)
    loaded = np.abs(p) > 0.5
    np.testing.assert_allclose(((p - q) / q * 50e3)[loaded], LAW.output_resistance, rtol=0.1)
