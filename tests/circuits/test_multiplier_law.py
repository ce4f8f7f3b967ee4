"""The law of the Gilbert multiplier: sweeps of the shipped subcircuit find its coefficients."""

from functools import cache

import numpy as np
import pytest
from library_table import CIRCUITS
from simulator import needs_ngspice

from ann_dc.backends.spice.ngspice import Ngspice
from ann_dc.hardware.parts import GILBERT

SCALES = (0.5, 0.8, 1.25)
SHARES = np.linspace(-1.0, 1.0, 7)
ADDED = (-0.4, 0.0, 0.4)
"""Volts of full scale, y over it, and z over it."""
LEVEL = CIRCUITS / "models" / "transistor"

pytestmark = needs_ngspice


def ran(cards: list[str], nodes: list[str]) -> np.ndarray:
    """(nodes, 21) volts while v(a) goes from -1 V to 1 V."""
    models = [(LEVEL / f"{name}.lib").read_text() for name in ("opamp", "mul4q")]
    saved = ".save " + "\n+ ".join(f"v({node})" for node in nodes)
    ends = [".dc Va -1 1 0.1", ".options reltol=1e-6 vntol=1e-8", saved, ".end\n"]
    raw = Ngspice(timeout=60).run("\n".join(["* sweep", *models, "Va a 0 0", *cards, *ends]))
    return np.array([np.real(raw[node]) for node in nodes])


@cache
def measured(volts: float) -> tuple[np.ndarray, ...]:
    """(x, y, z, out) of a full scale, x and y over it, on a grid."""
    cards, nodes, at = [f"E1 x 0 a 0 {volts}"], [], []
    for i, y in enumerate(SHARES):
        for j, z in enumerate(ADDED):
            cards += [
                f"Vy{i}_{j} y{i}_{j} 0 {y * volts:.9g}",
                f"Vz{i}_{j} z{i}_{j} 0 {z * volts:.9g}",
            ]
            cards += [f"X{i}_{j} x 0 y{i}_{j} 0 z{i}_{j} o{i}_{j} mul4q vm={volts}"]
            nodes.append(f"o{i}_{j}")
            at.append((y, z * volts))
    out = ran(cards, nodes)
    x = np.linspace(-1.0, 1.0, out.shape[1])
    y, z = (np.array(at).T[k][:, None] + 0 * out for k in (0, 1))
    within = np.abs(out) <= 1.05 * volts
    return tuple(array[within] for array in (x + 0 * out, y, z, out))


@pytest.mark.parametrize("volts", SCALES)
def test_a_sweep_is_the_law(volts):
    x, y, z, out = measured(volts)
    law = GILBERT.at(volts)
    slope = law.gain[0] + law.bend_x[0] * x**2 + law.bend_y[0] * y**2
    slope = slope + volts * (law.tilt_x * x + law.tilt_y * y)
    told = volts * x * y * (1 + slope) + (1 + law.follow[0]) * z + law.offset[0] + law.bow * out**2
    assert np.abs(out - volts * x * y - z).max() > 2e-4
    assert np.abs(out - told).max() < 3e-5


@pytest.mark.parametrize("volts", SCALES)
def test_a_sweep_finds_the_coefficients(volts):
    x, y, z, out = measured(volts)
    t, law = volts * x * y, GILBERT.at(volts)
    terms = [t, t * x**2, t * y**2, z, t * x * volts, t * y * volts, out**2, np.ones_like(t)]
    found = np.linalg.lstsq(np.array(terms).T, out - t - z, rcond=None)[0]
    known = [law.gain[0], law.bend_x[0], law.bend_y[0], law.follow[0]]
    known += [law.tilt_x, law.tilt_y, law.bow, law.offset[0]]
    off = np.abs(found - known)
    assert (off < [20e-6, 15e-6, 15e-6, 5e-6, 5e-6, 5e-6, 15e-6, 6e-6]).all(), off


def test_inputs_draw_a_current_and_outputs_have_a_resistance():
    cards = ["V1 one 0 1", "R1 a x 10k", "X1 x 0 one 0 0 o mul4q"]
    cards += ["X2 a 0 one 0 0 p mul4q", "X3 a 0 one 0 0 q mul4q", "R2 q 0 50k"]
    a, x, p, q = ran(cards, ["a", "x", "p", "q"])
    amperes = np.interp(0.0, a, (a - x) / 10e3)
    assert amperes == pytest.approx(GILBERT.input_current, rel=0.05)
    loaded = np.abs(p) > 0.5
    ohms = ((p - q) / q * 50e3)[loaded]
    np.testing.assert_allclose(ohms, GILBERT.output_resistance, rtol=0.1)


def test_the_gain_does_not_hang_on_how_many_there_are():
    one = ["X1 a 0 a 0 0 o mul4q"]
    others = [f"X_{number} 0 0 0 0 0 o{number} mul4q" for number in range(150)]
    alone, together = (ran(cards, ["o"]) for cards in (one, [*one, *others]))
    assert np.abs(alone - together).max() < 3e-5
