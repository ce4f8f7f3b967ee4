"""Runs with inputs over time, against closed forms and the optimum of every moment."""

import numpy as np
import pytest
from simulator import needs_ngspice

import ann_dc
from ann_dc import Waveform
from ann_dc.backends import ode, tracking_error
from ann_dc.backends.status import Outcome
from ann_dc.errors import NetworkError
from ann_dc.fidelity import predict
from ann_dc.network import Cell, Connection, Function, Limiter, Network, Neuron
from ann_dc.two_level import NewtonCoordinator

RAMP = Waveform(times=[0.0, 2.0, 3.0], values=[0.0, 2.0, 2.0])
HELD = Waveform(times=[0.0, 2.0, 3.0], values=[1.0, -1.0, 0.5], hold="previous")


def low_pass(waveform):
    """x' = u(t) - x from 0."""
    wires = Connection(source="x", target="x", weight=-1.0), Connection(source="u", target="x")
    cell = Cell(neurons=(Neuron(name="x"),), inputs=("u",), connections=wires)
    network = Network(cell=cell, stages=1, inputs={"u": 0.0}, title="low-pass")
    return network.with_inputs({"u": waveform})


def ramped(t):
    late = 2 + (np.exp(-2.0) - 1) * np.exp(-(t - 2))
    return np.where(t < 2, t - 1 + np.exp(-t), late)


def held(t):
    x, begins = np.zeros_like(t), (0.0, 2.0, 3.0)
    for begin, end, level in zip(begins, (2.0, 3.0, np.inf), HELD.values):
        spent = np.clip(np.minimum(t, end) - begin, 0, None)
        x = level + (x - level) * np.exp(-spent)
    return x


EXACT = {"ramp": (RAMP, ramped), "held": (HELD, held)}


@pytest.mark.parametrize("name", EXACT)
@pytest.mark.parametrize("method", ode.METHODS.values(), ids=lambda method: method.name)
def test_every_method_follows_the_closed_form(method, name):
    waveform, exact = EXACT[name]
    run = ann_dc.OdeBackend(method=method, duration=5.0).run(low_pass(waveform))
    trajectory = run.trajectory
    assert trajectory.time[-1] == 5.0
    np.testing.assert_allclose(trajectory["x"][:, 0], exact(trajectory.time), atol=1e-5)
    grid = np.linspace(0, 5, 101)
    np.testing.assert_allclose(trajectory.at(grid)[:, 0], exact(grid), atol=1e-4)


@needs_ngspice
@pytest.mark.parametrize("name", EXACT)
def test_circuits_follow_the_closed_form(name):
    waveform, exact = EXACT[name]
    backend = ann_dc.SpiceBackend(level=ann_dc.levels.macro(), duration=5.0)
    run = backend.run(low_pass(waveform))
    found = run.trajectory
    np.testing.assert_allclose(found["x"][:, 0], exact(found.time), atol=5e-4)


def circling(network, duration, count=41):
    """The car's target moves half a metre around (5, 5)."""
    times = np.linspace(0.0, duration, count)
    angle = 2 * np.pi * times / duration
    return network.with_inputs(
        {
            "q_d.x": Waveform(times=times, values=5 + 0.5 * np.cos(angle)),
            "q_d.y": Waveform(times=times, values=5 + 0.5 * np.sin(angle)),
        }
    )


@needs_ngspice
def test_a_car_follows_its_target_alike_in_the_ode_and_in_ngspice():
    network = ann_dc.design(
        ann_dc.plants.car(), preconditioner=ann_dc.PreconditionerKind.DIAGONAL
    ).network
    moving = circling(network, 800.0)
    ideal = tracking_error(ann_dc.OdeBackend(duration=800.0).run(moving).trajectory, samples=40)
    backend = ann_dc.SpiceBackend(level=ann_dc.levels.macro(), duration=800.0)
    built = tracking_error(backend.run(moving).trajectory, samples=40)
    assert 1e-3 < ideal.rms < 0.02
    assert built.rms == pytest.approx(ideal.rms, rel=0.01)
    np.testing.assert_allclose(built.error[20:], ideal.error[20:], rtol=0.02)


@pytest.mark.slow
def test_a_slower_target_is_followed_more_closely():
    network = ann_dc.design(ann_dc.plants.car()).network
    errors = [
        tracking_error(
            ann_dc.OdeBackend(duration=t).run(circling(network, t)).trajectory, samples=20
        ).rms
        for t in (200.0, 800.0)
    ]
    assert errors[1] == pytest.approx(errors[0] / 4, rel=0.3)


def test_a_moving_start_is_followed_as_well():
    network = ann_dc.design(ann_dc.plants.double_integrator(N=5)).network
    start = Waveform(times=[0.0, 500.0], values=[0.0, 0.3])
    run = ann_dc.OdeBackend(duration=500.0).run(network.with_inputs({"q_0.x": start}))
    assert tracking_error(run.trajectory, samples=10).rms < 1e-2
    shown = run.trajectory["q.x"][:, 0]  # a fixed neuron, which has the value of the input
    np.testing.assert_allclose(shown, 0.3 * run.trajectory.time / 500.0)


@pytest.mark.slow
def test_a_study_measures_the_tracking_error():
    network = circling(ann_dc.design(ann_dc.plants.car()).network, 400.0)
    study = ann_dc.Study(
        subject=network,
        vary={"nonideal.leak": [1e9, 30.0]},
        fixed={"run.duration": 400.0},
        metrics=["tracking_error"],
        curves=50,
    )
    right, leaky = study.run(workers=0)["tracking_error"]
    assert right < 0.03 < leaky


@needs_ngspice
def test_boards_follow_and_are_not_predicted():
    level = ann_dc.presets.get("opa192_ad734")
    moving = low_pass(Waveform(times=[0.0, 2.0], values=[0.0, 0.5]))
    backend = ann_dc.SpiceBackend(level=level, duration=4.0)
    run = backend.run(moving)
    assert run.trajectory["x"][-1, 0] == pytest.approx(
        0.5 - 0.25 * (1 - np.exp(-2)) * np.exp(-2), abs=2e-3
    )
    circuit, probe = backend.prepare(moving)
    with pytest.raises(NetworkError, match="emulation: inputs u change over time"):
        predict(circuit, level, probe)


@pytest.mark.parametrize(
    ("run", "named"),
    [
        (lambda n: ann_dc.OdeBackend().run(n), r"duration: low-pass has inputs over time \(u\)"),
        (lambda n: ann_dc.OdeBackend().run_batch(n, {}), "duration: low-pass has inputs over time"),
        (lambda n: ann_dc.RecurrentBackend().run(n), "inputs: u change over time"),
    ],
)
def test_what_cannot_follow_says_so(run, named):
    with pytest.raises(NetworkError, match=named):
        run(low_pass(RAMP))


@pytest.mark.parametrize("method", ode.METHODS.values(), ids=lambda method: method.name)
def test_a_saturated_neuron_lets_go_when_its_input_turns(method):
    """x' = u within -1 and 1, with u from 1 to -1 in 100: from 1 at t = 50 on, x falls."""
    wire = Connection(source="u", target="x")
    neuron = Neuron(name="x", limiter=Limiter(low=-1.0, high=1.0))
    network = Network(cell=Cell(neurons=(neuron,), inputs=("u",), connections=(wire,)), stages=1,
                      inputs={"u": 0.0})  # fmt: skip
    ramp = Waveform(times=[0.0, 100.0], values=[1.0, -1.0])
    run = ann_dc.OdeBackend(method=method, duration=60.0).run(network.with_inputs({"u": ramp}))
    assert run.trajectory["x"][-1, 0] == pytest.approx(1 - 10.0**2 / 100, abs=1e-2)


def test_layers_and_two_levels_refuse_inputs_over_time():
    network = ann_dc.synthesize(ann_dc.plants.double_integrator(N=3))
    moving = network.with_inputs({"q_d.x": Waveform(times=[0.0, 1.0], values=[1.0, 2.0])})
    for made in (
        lambda: ann_dc.RecurrentLayer(moving),
        lambda: ann_dc.TwoLevels(moving, upper=NewtonCoordinator()),
    ):
        with pytest.raises(NetworkError, match=r"q_d\.x change over time"):
            made()


@pytest.mark.slow
@needs_ngspice
def test_a_driven_oscillator_has_the_steps_of_an_oscillator():
    """x'' = -x + u: an input of zero over time is none."""
    wires = (
        Connection(source="y", target="x"),
        Connection(source="x", target="y", weight=-1.0),
        Connection(source="u", target="y"),
    )
    cell = Cell(neurons=(Neuron(name="x"), Neuron(name="y")), inputs=("u",), connections=wires)
    network = Network(cell=cell, stages=1, inputs={"u": 0.0}, start={"x": 1.0})
    still = network.with_inputs({"u": Waveform(times=[0.0, 100.0], values=[0.0, 0.0])})
    backend = ann_dc.SpiceBackend(level=ann_dc.levels.macro(), duration=100.0)
    errors = [backend.run(each).mean_square_error for each in (network, still)]
    assert errors[1] == pytest.approx(errors[0], rel=0.1)


@pytest.mark.parametrize("method", ode.METHODS.values(), ids=lambda method: method.name)
def test_an_input_that_drives_a_block_out_of_its_domain_is_named(method):
    """x' = a(t) - sqrt(x) has no equilibrium once a is negative."""
    cell = Cell(
        neurons=(Neuron(name="x"),),
        inputs=("a",),
        blocks=(Function(name="root", function="sqrt", x="x"),),
        connections=(
            Connection(source="root", target="x", weight=-1.0),
            Connection(source="a", target="x", weight=1.0),
        ),
    )
    network = Network(cell=cell, stages=1, start={"x": 1.0}, inputs={"a": 1.0})
    falls = Waveform(times=[0.0, 1.0, 2.0], values=[1.0, 1.0, -2.0])
    run = ann_dc.OdeBackend(duration=15.0, method=method).run(network.with_inputs({"a": falls}))
    assert run.status.outcome is Outcome.LEFT_DOMAIN
    assert "root in cell 0" in str(run.status)
