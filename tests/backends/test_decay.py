"""The rate of a tail: closed forms, then the spectrum of plants."""

import numpy as np
import pytest
from designs import designed
from hypothesis import given, strategies as st

import ann_dc
from ann_dc.backends.decay import decay_rate
from ann_dc.backends.trajectory import Trajectory
from ann_dc.network.cell import Cell, Neuron
from ann_dc.network.network import Network

ONE = Network(cell=Cell(neurons=(Neuron(name="x"),)), stages=1)


def curve(time: np.ndarray, residual: np.ndarray) -> Trajectory:
    return Trajectory(
        network=ONE, time=time, states=residual[:, None], residual_time=time,
        residuals=np.column_stack([residual, 0 * residual]),
    )  # fmt: skip


@given(st.floats(0.1, 10.0), st.floats(0.01, 100.0), st.integers(0, 2**32 - 1))
def test_that_of_an_exponential_is_exact(rate, size, seed):
    gaps = np.random.default_rng(seed).uniform(0.01, 0.3, 400)
    time = np.cumsum(gaps) / rate
    found = decay_rate(curve(time, size * np.exp(-rate * time)))
    assert found == pytest.approx(rate, rel=1e-9)


def test_neither_oscillation_nor_short_steps_count():
    """Ten times as many looks in the second half, and a residual that goes up and down."""
    time = np.concatenate([np.arange(0, 10, 0.1), np.arange(10, 20, 0.01)])
    residual = np.exp(-time) * (1.2 + np.cos(20 * time))
    assert decay_rate(curve(time, residual)) == pytest.approx(1.0, rel=0.01)


def test_what_comes_before_the_tail_does_not_count():
    time = np.linspace(0, 30, 3001)
    residual = np.where(time < 10, 1.0, np.exp(-2 * (time - 10)))
    assert decay_rate(curve(time, residual)) == pytest.approx(2.0, rel=1e-6)


def test_a_run_that_does_not_get_there_has_none():
    time = np.linspace(0, 10, 101)
    assert np.isnan(decay_rate(curve(time, np.exp(-time))))
    assert np.isnan(decay_rate(curve(time[:3], np.array([1.0, 1e-5, 1e-9]))))


@pytest.mark.parametrize("name", ["car", "double_integrator", "van_der_pol"])
def test_it_is_the_abscissa_of_the_spectrum(name):
    network = designed(name).network
    trajectory = ann_dc.OdeBackend(verify=False).run(network).trajectory
    slowest = -ann_dc.spectrum(network, trajectory.final).abscissa
    assert decay_rate(trajectory, 1e-5, 1e-8) == pytest.approx(slowest, rel=0.3)
