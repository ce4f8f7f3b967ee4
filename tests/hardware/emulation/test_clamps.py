"""Clamps in emulations: what those that are off lag by, and how far those that conduct give way."""

from dataclasses import replace

import numpy as np
import pytest
from simulator import needs_ngspice

from ann_dc import SpiceBackend
from ann_dc.fidelity import Specimen, predict
from ann_dc.hardware.parts import Level, macro, presets
from ann_dc.network import Cell, Connection, Limiter, Network, Neuron

MARGIN = 60.0
INSIDE = {"x": (-3.2, 3.2), "y": (-3.2, 3.2)}


def oscillator(rail: float, leak: float = 0.03) -> Network:
    """Two neurons that turn around each other once in 2 pi, and come to rest slowly."""
    limits = Limiter(low=-rail, high=rail)
    ends = (
        ("x", "x", -leak), ("y", "x", 1.0), ("y", "y", -leak), ("x", "y", -1.0), ("one", "y", 0.3),
    )  # fmt: skip
    return Network(
        stages=1,
        cell=Cell(
            neurons=tuple(Neuron(name=name, limiter=limits) for name in "xy"),
            connections=tuple(Connection(source=s, target=t, weight=w) for s, t, w in ends),
        ),
    )


def board(preset: str) -> SpiceBackend:
    """Of its parts, at a margin, whether it rings or not."""
    level = replace(presets.get(preset), full_scale=1.0)
    return SpiceBackend(level=level, margin=MARGIN, require_stable=False, intervals=INSIDE)


def growth(backend: SpiceBackend, network: Network) -> float:
    """Of the emulation, per unit of network time."""
    circuit, probe = backend.prepare(network)
    return Specimen(circuit=circuit, level=backend.level, probe=probe).modes.abscissa


@pytest.mark.parametrize("preset", ["opa828_ad734", "ad8065_ad835", "tl072_ad633"])
def test_clamps_that_are_off_damp_what_turns_by_what_they_lag(preset):
    """h = x - n s tau x' makes lambda = i - n s tau of lambda = i, to first order."""
    backend = board(preset)
    circuit, _ = backend.prepare(oscillator(3.0))
    sheet, T = backend.level.datasheet, circuit.scaling.time
    inside = sheet.rout * float(circuit.capacitors["x"][0]) / 5
    outside = (2 + sheet.rout * sheet.gbw / 20e9) / (2 * np.pi * sheet.gbw)
    damped = growth(backend, oscillator(3.0)) - growth(backend, oscillator(np.inf))
    assert damped == pytest.approx(-0.4 * (inside + outside) / T, rel=0.1)


@needs_ngspice
def test_a_board_that_swings_comes_to_rest_with_clamps():
    """Both as emulated: the same network without rails grows in ngspice, too."""
    backend = board("ad8065_ad835")
    for network, sign in ((oscillator(np.inf), 1), (oscillator(3.0), -1)):
        said, run = growth(backend, network), backend.run(network)
        assert np.sign(said) == sign
        assert envelope(run) == pytest.approx(said, abs=2e-3)


def envelope(run) -> float:
    """By what the logarithm of its swings grows, per unit of network time."""
    time, off = run.trajectory.time, np.abs(run.trajectory.states[:, 0] - run.probe.final[0])
    peaks = np.flatnonzero((off[1:-1] > off[:-2]) & (off[1:-1] > off[2:])) + 1
    peaks = peaks[(off[peaks] > 3e-3) & (off[peaks] < 0.9) & (time[peaks] > 1)]
    assert len(peaks) > 6
    return float(np.polyfit(time[peaks], np.log(off[peaks]), 1)[0])


def pressed(push: float) -> Network:
    """x' = push - x, between -1/2 and 1/2, and y' = x - y."""
    ends = (("x", "x", -1.0), ("one", "x", push), ("y", "y", -1.0), ("x", "y", 1.0))
    return Network(
        stages=1,
        cell=Cell(
            neurons=(Neuron(name="x", limiter=Limiter(low=-0.5, high=0.5)), Neuron(name="y")),
            connections=tuple(Connection(source=s, target=t, weight=w) for s, t, w in ends),
        ),
    )


@needs_ngspice
@pytest.mark.parametrize("push", [0.6, 1.2, -1.2])
def test_a_clamp_gives_way_to_what_presses(push):
    """Of little gain, so that it shows: a diode's drop, and more the more it presses."""
    level: Level = macro(a0=1e3, rout=50.0)
    run = SpiceBackend(level=level).run(pressed(push))
    said = predict(run.circuit, level, run.probe)
    assert abs(run.trajectory.final[0]) > 0.5 + 5e-4
    assert said.control_error == pytest.approx(run.control_error, rel=0.1)
