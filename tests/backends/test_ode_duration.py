"""Runs of a given duration: exactly that long, whether or not a network settles."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, strategies as st
from oscillators import chua, lorenz, lorenz_96, reference, van_der_pol, wire, wired

import ann_dc
from ann_dc.backends import ode
from ann_dc.backends.status import Outcome
from ann_dc.errors import AnnDcError

TIGHT = {"rtol": 1e-9, "atol": 1e-12}


@pytest.mark.sampled(4)
@pytest.mark.parametrize("method", ode.METHODS.values(), ids=lambda method: method.name)
def test_every_method_ends_exactly_then(method):
    run = ann_dc.OdeBackend(method=method, duration=20.0).run(van_der_pol())
    assert run.status.outcome is Outcome.COMPLETED
    assert run.status.time == run.trajectory.time[-1] == 20.0
    assert np.isnan(run.settling_time)
    wanted = reference(van_der_pol(), 20.0)(20.0)
    np.testing.assert_allclose(run.trajectory.final, wanted, atol=1e-3)


@pytest.mark.parametrize(
    ("network", "duration"),
    [(van_der_pol(), 60.0), (chua(), 8.7), (lorenz(), 2.2), (lorenz_96(), 2.0)],
    ids=lambda value: getattr(value, "title", ""),
)
def test_oscillators_and_chaos_are_scipys(network, duration):
    method = replace(ode.COMPILED, **TIGHT)
    trajectory = ann_dc.OdeBackend(method=method, duration=duration).run(network).trajectory
    wanted = reference(network, duration)(trajectory.time).T
    assert np.abs(trajectory.states - wanted).max() < 1e-5 * np.abs(wanted).max()


def test_a_run_of_more_steps_than_the_largest_number_is_not_cut_short():
    run = ann_dc.OdeBackend(duration=300.0, most_steps=100).run(van_der_pol())
    assert run.trajectory.time[-1] == 300.0
    assert run.steps > 100


def test_a_network_at_rest_at_the_end_has_settled_when_it_does_alone():
    network = ann_dc.design(ann_dc.plants.double_integrator(N=5)).network
    alone = ann_dc.OdeBackend().run(network)
    run = ann_dc.OdeBackend(duration=2 * alone.status.time).run(network)
    assert run.status.settled
    assert run.status.time == 2 * alone.status.time
    assert run.settling_time == pytest.approx(alone.settling_time, rel=1e-6)
    assert "agrees" in run.verified


def test_a_network_that_has_not_settled_yet_is_told_so():
    network = ann_dc.design(ann_dc.plants.double_integrator(N=5)).network
    run = ann_dc.OdeBackend(duration=5.0).run(network)
    assert run.status.outcome is Outcome.COMPLETED
    assert "the given duration" in str(run.status)


@pytest.mark.slow
@given(st.floats(1e-3, 40.0), st.integers(1, 9))
def test_samples_end_together_and_are_scipys(duration, count):
    starts = np.column_stack([np.linspace(-2, 2, count), np.zeros(count)])
    batch = ann_dc.OdeBackend(duration=duration, curves=50).run_batch(van_der_pol(), {}, starts)
    wanted = reference(van_der_pol(), duration, starts[0])(duration)
    np.testing.assert_allclose(batch.states[0], wanted, atol=5e-3)
    for sample in range(count):
        assert batch.outcomes[sample] in (Outcome.COMPLETED, Outcome.SETTLED)  # at rest from (0, 0)
        assert batch.trajectory(sample).time[-1] == duration


def test_settled_samples_of_a_duration_have_their_settling_times():
    network = ann_dc.design(ann_dc.plants.double_integrator(N=5)).network
    inputs = {"q_d.x": [0.5, 1.0, 2.0]}
    alone = ann_dc.OdeBackend().run_batch(network, inputs)
    batch = ann_dc.OdeBackend(duration=200.0).run_batch(network, inputs)
    assert batch.settled.all()
    np.testing.assert_allclose(batch.settling_times, alone.settling_times, rtol=1e-4)
    assert "3 of 3 samples settled" in str(batch)


def test_a_network_that_grows_still_diverges():
    network = wired("growing", "x", (), (wire("x", "x", 1.0),), (1.0,))
    run = ann_dc.OdeBackend(duration=100.0).run(network)
    assert run.status.outcome is Outcome.DIVERGED
    assert run.status.time < 100


@pytest.mark.parametrize("duration", [0.0, -1.0, float("nan"), float("inf"), "long"])
def test_a_duration_is_a_positive_number(duration):
    with pytest.raises((AnnDcError, TypeError), match="duration"):
        ann_dc.OdeBackend(duration=duration)


def test_a_limit_ends_exactly_where_it_says():
    """In fastest time constants at the start: the eigenvalues there have the magnitude one."""
    run = ann_dc.OdeBackend(limit=100, verify=False).run(van_der_pol())
    assert run.status.outcome is Outcome.NOT_SETTLED
    assert run.trajectory.time[-1] == pytest.approx(100.0, rel=1e-12)


def test_settling_time_with_an_input_over_time_is_counted_from_its_last_change():
    network = ann_dc.design(ann_dc.plants.double_integrator(N=4), preconditioner="diagonal").network
    moved = ann_dc.Waveform(times=[0.0, 50.0], values=[0.5, 1.0], hold="previous")
    network = network.with_inputs({"q_d.x": moved})
    run = ann_dc.OdeBackend(duration=400.0).run(network)
    assert run.status.settled
    assert 50.0 < run.settling_time < 300.0
    at_end = network.with_inputs({"q_d.x": 1.0}).with_start(run.trajectory.at([50.0])[0])
    alone = ann_dc.OdeBackend().run(at_end)
    assert run.settling_time == pytest.approx(50.0 + alone.settling_time, rel=0.01)
