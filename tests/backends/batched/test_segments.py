"""Inputs over time in batches: closed forms, and every sample as its own network alone."""

import numpy as np
import pytest
from designs import designed

import ann_dc
from ann_dc import Waveform
from ann_dc.backends import ode
from ann_dc.backends.batch import BatchRun
from ann_dc.backends.status import Outcome
from ann_dc.errors import NetworkError
from ann_dc.evaluation import evaluator
from ann_dc.evaluation.variant_numbers import numbers_of
from ann_dc.hardware.nonidealities.numbers import mismatch
from ann_dc.network import Cell, Connection, Function, Limiter, Network, Neuron, Sum, Template

TIGHT = ode.COMPILED.tighter(1e5)
SIZES = np.linspace(-2.0, 2.0, 11)
BREAKS = np.array([0.0, 0.7, 2.0, 2.1, 4.0])


def low_pass(**settings) -> Network:
    """x' = u(t) - x from 0, or the same with a limiter."""
    wires = Connection(source="x", target="x", weight=-1.0), Connection(source="u", target="x")
    cell = Cell(neurons=(Neuron(name="x", **settings),), inputs=("u",), connections=wires)
    return Network(cell=cell, stages=1, inputs={"u": 0.0}, title="low-pass")


def filtered(times, values, hold, end):
    """Exact end of x' = u(t) - x from 0; values (K, B)."""
    x, times = np.zeros(values.shape[1]), np.append(times, end)
    for k, h in enumerate(np.diff(times)):
        u, decay = values[k], np.exp(-h)
        last = k == len(values) - 1 or hold == "previous"
        slope = 0.0 if last else (values[k + 1] - u) / h
        x = x * decay + u * (1 - decay) + slope * (h - (1 - decay))
    return x


@pytest.mark.parametrize("hold", ["linear", "previous"])
@pytest.mark.parametrize("method", [ode.BATCHES, ode.BATCHES.tighter(1e4), TIGHT], ids=str)
def test_samples_follow_their_own_closed_form(hold, method):
    values = np.random.default_rng(3).normal(size=(len(BREAKS), 21))
    waveform = Waveform(times=BREAKS, values=values, hold=hold)
    batch = ann_dc.OdeBackend(method=method, duration=5.0).run_batch(low_pass(), {"u": waveform})
    wanted = filtered(BREAKS, values, hold, 5.0)
    np.testing.assert_allclose(batch.states[:, 0], wanted, atol=3 * method.rtol)
    assert set(batch.outcomes) == {Outcome.COMPLETED}
    assert np.ptp(wanted) > 0.5


def test_a_sine_of_a_thousand_samples_is_followed():
    times = np.linspace(0.0, 10.0, 1001)
    speeds = np.array([0.5, 1.0, 2.0])
    waveform = Waveform(times=times, values=np.sin(np.outer(times, speeds)))
    backend = ann_dc.OdeBackend(duration=10.0, curves=300)
    batch = backend.run_batch(low_pass(), {"u": waveform})
    for sample, w in enumerate(speeds):
        curve = batch.trajectory(sample)
        t = np.append(np.linspace(0.0, 10.0, 37), curve.time[1:-1:10])
        wanted = (np.sin(w * t) - w * np.cos(w * t) + w * np.exp(-t)) / (1 + w * w)
        np.testing.assert_allclose(curve.at(t)[:, 0], wanted, atol=w * w * 2e-5)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("shape", ["()", "(B,)", "(B, N)"])
def test_values_have_the_axes_of_constant_inputs(shape):
    network = designed("car").network
    end = {
        "()": 4.5,
        "(B,)": np.array([4.0, 5.0, 4.2]),
        "(B, N)": np.outer([4.0, 5.0, 4.2], np.ones(network.stages)),
    }
    values = np.array([0 * end[shape] + 5.0, end[shape]])
    waveform = Waveform(times=[0.0, 50.0], values=values)
    given = {"q_d.x": waveform, "q_d.y": np.array([5.0, 5.1, 5.2])}
    alone(ann_dc.OdeBackend(duration=80.0), network, given)


def alone(backend, network, inputs, rtol=1e-5, **settings) -> BatchRun:
    """Run a batch whose samples are compared with their networks alone."""
    batch = backend.run_batch(network, inputs, x=network.start_state, **settings)
    for sample in range(len(batch)):
        own = batch.network_of(sample)
        assert own.waveforms.keys() == batch.waveforms.keys()
        one = ann_dc.OdeBackend(duration=backend.duration, method=TIGHT).run(own)
        scale = np.abs(one.trajectory.states).max()
        np.testing.assert_allclose(batch.states[sample], one.trajectory.final, atol=rtol * scale)
    return batch


@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", ["car", "unicycle", "double_integrator"])
def test_samples_are_their_networks_alone(name):
    network = designed(name).network
    target, start = network.inputs["q_d.x"][0], network.inputs["q_0.x"][0]
    steps = np.array([[0.0, 0.0, 0.0], [0.1, -0.2, 0.3], [0.1, 0.2, -0.1], [0.0, 0.1, 0.1]])
    inputs = {
        "q_d.x": Waveform(times=[0.0, 20.0, 30.0, 60.0], values=target + steps),
        "q_0.x": Waveform(times=[5.0, 25.0], values=start + steps[:2], hold="previous"),
    }
    batch = alone(ann_dc.OdeBackend(duration=90.0), network, inputs)
    assert np.ptp(batch.states, axis=0).max() > 0.01


def test_waveforms_of_the_network_are_those_of_all_samples():
    moving = low_pass().with_inputs({"u": Waveform(times=[0.0, 1.0], values=[0.0, 1.0])})
    batch = alone(ann_dc.OdeBackend(duration=2.0), moving, {})
    assert batch.states[0, 0] == pytest.approx(1 - (np.e - 1) * np.exp(-2.0), rel=1e-5)
    still = ann_dc.OdeBackend(duration=2.0).run_batch(moving, {"u": [1.0, 2.0]})
    np.testing.assert_allclose(still.states[:, 0], [0.8646647, 1.7293294], rtol=1e-5)
    assert not still.waveforms


def test_samples_have_numbers_and_waveforms_of_their_own():
    network = designed("double_integrator").network
    networks = [mismatch(network, 0.02, seed=seed) for seed in range(3)]
    ramp = Waveform(times=[0.0, 30.0], values=[[1.0, 1.0, 1.0], [1.2, 0.8, 1.1]])
    alone(ann_dc.OdeBackend(duration=60.0), network, {"q_d.x": ramp}, numbers=numbers_of(networks))


def delayed() -> Network:
    """Three cells that read the cell before: a neuron, a block and an input with a left end."""
    previous = Template.PREVIOUS
    wires = (
        Connection(source="x", target="x", weight=-1.0),
        Connection(source="x", target="x", weight=0.5, template=previous),
        Connection(source="s", target="x", weight=0.3, template=previous),
        Connection(source="u", target="x", weight=0.7, template=previous),
        Connection(source="x", target="s", weight=2.0),
        Connection(source="v", target="s", weight=-1.0),
    )
    cell = Cell(
        neurons=(Neuron(name="x"),), inputs=("u", "v"), blocks=(Sum(name="s"),), connections=wires
    )
    ends = {"x": "u", "s": "v", "u": "v"}
    return Network(cell=cell, stages=3, inputs={"u": 0.0, "v": 1.0}, left_boundary=ends)


def test_values_beyond_the_left_end_change_as_well():
    rng = np.random.default_rng(1)
    u = Waveform(times=[0.0, 1.0, 2.5], values=rng.normal(size=(3, 9, 3)))
    v = Waveform(times=[0.0, 1.7, 2.0], values=rng.normal(size=(3, 9)), hold="previous")
    alone(ann_dc.OdeBackend(duration=3.0), delayed(), {"u": u, "v": v}, rtol=2e-5)


def test_saturated_neurons_let_go_when_their_input_turns():
    network = low_pass(limiter=Limiter(low=-1.0, high=1.0))
    waveform = Waveform(times=[0.0, 2.0, 4.0], values=np.outer([0.0, 5.0, -5.0], SIZES))
    batch = alone(ann_dc.OdeBackend(duration=3.0), network, {"u": waveform}, rtol=1e-3)
    assert np.abs(batch.states).max() < 1.0  # 1 at the turn


def test_the_bits_of_a_sample_depend_on_nothing_beside_it():
    """Kinks of which steps are refused, also in attempts in which another sample begins."""
    times = np.linspace(0.0, 150.0, 16)
    waves = Waveform(times=times, values=np.random.default_rng(0).normal(size=(16, 400)) ** 5)
    backend, network = ann_dc.OdeBackend(duration=151.0, threads=1), low_pass()
    whole = backend.run_batch(network, {"u": waves})
    two = ann_dc.OdeBackend(duration=151.0, threads=2).run_batch(network, {"u": waves})
    np.testing.assert_array_equal(whole.states, two.states)
    for few in (slice(40, 53), slice(None, None, -7), slice(99, 100)):
        part = Waveform(times=waves.times, values=waves.values[:, few])
        some = backend.run_batch(network, {"u": part})
        np.testing.assert_array_equal(whole.states[few], some.states)
        np.testing.assert_array_equal(whole.steps[few], some.steps)


def test_the_settling_time_is_the_last_exit_with_the_inputs_of_its_time():
    network = designed("double_integrator").network
    ramp = Waveform(times=[0.0, 9.0, 30.0], values=np.outer([1.0, 0.9, 1.2], [1.0, 1.1]))
    backend = ann_dc.OdeBackend(duration=300.0, curves=500)
    batch = backend.run_batch(network, {"q_d.x": ramp})
    assert batch.settled.all()
    assert (batch.settling_times > 30.0).all()
    for sample, time in enumerate(batch.settling_times):
        own = batch.network_of(sample).at_time(time)
        residuals = evaluator(own).residuals(batch.trajectory(sample).at([time])[0])
        assert max(residuals) == pytest.approx(1e-6, rel=0.02)


def test_an_exit_during_a_ramp_is_located_with_the_ramp():
    """x' = u(t) - x, whose residual becomes small while u rises by half the tolerance in a step."""
    levels = [2.0, 1.0, 1.0, 1.0 + 2.4e-6]
    drop = Waveform(times=[0.0, 1.0, 8.0, 20.0], values=np.outer(levels, SIZES))
    batch = ann_dc.OdeBackend(duration=40.0, curves=200).run_batch(low_pass(), {"u": drop})
    for sample in np.flatnonzero(batch.settled & (batch.settling_times > 0)):
        time = batch.settling_times[sample]
        own = batch.network_of(sample).at_time(time)
        residuals = evaluator(own).residuals(batch.trajectory(sample).at([time])[0])
        assert 8.0 < time < 20.0
        assert max(residuals) == pytest.approx(1e-6, rel=0.02)
    assert batch.settled.sum() >= 10


def test_a_jump_out_of_a_domain_fails_only_its_sample():
    wires = (
        Connection(source="x", target="x", weight=-1.0),
        Connection(source="u", target="s"),
        Connection(source="g", target="x"),
    )
    blocks = Sum(name="s"), Function(name="g", function="reciprocal", x="s")
    cell = Cell(neurons=(Neuron(name="x"),), inputs=("u",), blocks=blocks, connections=wires)
    network = Network(cell=cell, stages=1, inputs={"u": 1.0})
    jump = Waveform(times=[0.0, 1.0], values=[[1.0, 1.0, 1.0], [2.0, -1.0, 0.5]], hold="previous")
    batch = ann_dc.OdeBackend(duration=5.0).run_batch(network, {"u": jump})
    left, completed = Outcome.LEFT_DOMAIN, Outcome.COMPLETED
    assert batch.outcomes == (completed, left, completed)
    begun = 1 - np.exp(-1.0)
    wanted = [end + (begun - end) * np.exp(-4.0) for end in (0.5, 2.0)]
    np.testing.assert_allclose(batch.states[[0, 2], 0], wanted, rtol=1e-5)


def test_a_short_segment_does_not_shorten_the_steps_behind_it():
    times = np.array([0.0, 1.0, 1.0 + 1e-9, 2.0])
    steps = [
        ann_dc.OdeBackend(duration=20.0)
        .run_batch(low_pass(), {"u": Waveform(times=t, values=np.ones((len(t), 1)))})
        .steps[0]
        for t in (times, times[[0, 1, 3]])
    ]
    assert steps[0] <= steps[1] + 2


RAMP = Waveform(times=[0.0, 1.0], values=[[0.0, 0.0], [1.0, 2.0]])


@pytest.mark.parametrize(
    ("run", "named"),
    [
        (lambda n: ann_dc.OdeBackend().run_batch(n, {"u": RAMP}), "duration: low-pass has inputs"),
        (
            lambda n: ann_dc.OdeBackend(duration=1.0).run_batch(n, {"u": RAMP}, x=np.zeros((3, 1))),
            "sizes of the batch",
        ),
        (lambda n: ann_dc.RecurrentBackend().run_batch(n, {"u": RAMP}), "inputs: u change"),
        (lambda n: n.with_inputs({"u": RAMP}), r"u\]"),
    ],
)
def test_what_cannot_be_followed_is_refused(run, named):
    with pytest.raises(NetworkError, match=named):
        run(low_pass())
