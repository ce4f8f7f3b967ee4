"""Waveforms of circuits whose networks do not settle, against closed forms."""

import math
from dataclasses import replace

import numpy as np
import pytest
from oscillators import van_der_pol, wire

import ann_dc
from ann_dc.backends.ode import OdeBackend
from ann_dc.errors import NetworkError
from ann_dc.fidelity import CircuitInstance, study_circuit
from ann_dc.fidelity.prediction import Unpredicted
from ann_dc.fidelity.waveform_prediction import (
    final_difference,
    follows_until,
    predicted_waveforms,
)
from ann_dc.network import Cell, Network, Neuron, Waveform


def swing(omega=1.0):
    """x'' = -omega^2 x, x = cos(omega t)."""
    wires = wire("y", "x", omega), wire("x", "y", -omega)
    cell = Cell(neurons=(Neuron(name="x"), Neuron(name="y")), connections=wires)
    return Network(cell=cell, stages=1, start={"x": 1.0}, title="swing")


def instance_of(network, duration, **settings):
    level = ann_dc.levels.macro(**settings)
    backend = ann_dc.SpiceBackend(level=level, duration=duration)
    circuit, probe = backend.prepare(network)
    return CircuitInstance(circuit=circuit, level=level, probe=probe)


def test_time_until_which_a_run_is_followed_is_that_of_the_first_exit():
    """cos and sin lag by e t, so they differ by 2 sin(e t / 2) sin or cos of the mean phase."""
    probe = OdeBackend(duration=20.0, verify=False).run(swing()).trajectory
    time, lag = np.linspace(0.0, 20.0, 20001), 1e-3
    late = np.stack([np.cos((1 - lag) * time), -np.sin((1 - lag) * time)], axis=1)
    mean = (1 - lag / 2) * time
    largest = np.maximum(np.abs(np.sin(mean)), np.abs(np.cos(mean)))
    off = 2 * np.sin(lag * time / 2) * largest
    assert follows_until(probe, time, late) == pytest.approx(time[(off > 0.01).argmax()], abs=2e-3)
    assert follows_until(probe, time[:9000], late[:9000]) == math.inf
    assert final_difference(late[-1], probe) == pytest.approx(off[-1], rel=1e-3)


def test_emulation_with_fast_parts_follows_the_oscillator():
    found = predicted_waveforms(instance_of(swing(), 6 * math.pi))
    assert not isinstance(found, Unpredicted)
    np.testing.assert_allclose(found.final, [1.0, 0.0], atol=1e-3)
    assert found.final_error < 1e-3
    assert found.follows_until == math.inf


@pytest.mark.slow
def test_finite_gain_damps_the_oscillator():
    """An integrator of gain a0 leaks at a rate proportional to 1 / a0."""
    ends = {}
    for gain in (1e4, 1e5, 1e6):
        found = predicted_waveforms(instance_of(swing(), 40 * math.pi, a0=gain))
        assert not isinstance(found, Unpredicted)
        ends[gain] = np.hypot(*found.final)
    leaks = [ends[1e6] - ends[gain] for gain in (1e5, 1e4)]
    assert leaks[1] / leaks[0] == pytest.approx((1e-4 - 1e-6) / (1e-5 - 1e-6), rel=0.02)


def test_inputs_over_time_are_not_emulated():
    wires = wire("x", "x", -1.0), wire("load", "x")
    cell = Cell(neurons=(Neuron(name="x"),), inputs=("load",), connections=wires)
    ramp = Waveform(times=[0.0, 10.0], values=[0.0, 1.0])
    network = Network(cell=cell, stages=1, inputs={"load": 0.0}).with_inputs({"load": ramp})
    found = predicted_waveforms(instance_of(network, 10.0))
    assert isinstance(found, Unpredicted)
    assert "inputs load change over time" in str(found)


@pytest.mark.parametrize("name", ["items", "samples", "loops"])
def test_analyses_of_the_settled_point_are_refused(name):
    backend = ann_dc.SpiceBackend(level=ann_dc.levels.macro(), duration=5.0)
    with pytest.raises(NetworkError, match=f"{name}: expected a network that settles"):
        study_circuit(van_der_pol(), backend, simulated=False, **{name: 2})


def test_study_of_an_oscillator_has_waveforms_in_place_of_a_prediction():
    backend = ann_dc.SpiceBackend(level=ann_dc.levels.macro(), duration=20.0)
    found = study_circuit(van_der_pol(), backend, simulated=False)
    assert found.moves
    assert found.prediction is None
    assert found.waveforms is not None
    assert found.within_tolerance
    assert math.isnan(found.noise)
    settled = study_circuit(damped(), replace(backend, duration=None), simulated=False)
    assert settled.prediction is not None
    np.testing.assert_allclose(settled.prediction.final, [0.0, 0.0], atol=1e-6)


def damped():
    wires = wire("v", "x"), wire("x", "v", -1.0), wire("v", "v", -1.0)
    cell = Cell(neurons=(Neuron(name="x"), Neuron(name="v")), connections=wires)
    return Network(cell=cell, stages=1, start={"x": 1.0}, title="damped")
