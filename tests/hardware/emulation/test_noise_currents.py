"""Noise: densities from the resistors of a circuit, samples from a seed."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from ann_dc.errors import ArgumentError, NetworkError
from ann_dc.hardware.circuit.circuit import circuit_of
from ann_dc.hardware.circuit.scaling import ProbeRun, scale
from ann_dc.hardware.emulation.noise_currents import Noise, draw_noise, noise_sources, white
from ann_dc.hardware.schematic.schematic import schematic_of
from ann_dc.network.cell import Cell, Connection, Neuron, Sum, Template
from ann_dc.network.ends import Omitted
from ann_dc.network.network import Network

BOLTZMANN = 1.380649e-23
NANOSECONDS = Noise(step=10e-9, seed=3)


def chain(extra: bool = False) -> Network:
    """x' = s - x, with s of both neighbours; ``extra`` adds a neuron that reads x."""
    neurons = (Neuron(name="x"), *([Neuron(name="y")] if extra else []))
    connections = (
        Connection(source="x", target="s", weight=0.5, template=Template.PREVIOUS),
        Connection(source="x", target="s", weight=-0.25, template=Template.NEXT),
        Connection(source="s", target="x"),
        Connection(source="x", target="x", weight=-1.0),
        *([Connection(source="x", target="y"), Connection(source="y", target="y", weight=-1.0)])
        * extra,
    )
    cell = Cell(neurons=neurons, blocks=(Sum(name="s"),), connections=connections)
    return Network(cell=cell, stages=4, start={"x": 1.0})


@cache
def built(extra: bool = False, differential: bool = False):
    network = chain(extra)
    states = np.array([network.start_state, 0 * network.start_state])
    scaling = scale(network, ProbeRun(states=states, times=np.array([0.0, 1.0]), radius=2.0))
    return circuit_of(schematic_of(network, differential=differential), scaling)


# ---- where it enters -----------------------------------------------------------------------------


def conductances() -> dict[str, np.ndarray]:
    return {source.name: source.conductance for source in noise_sources(built())}


def test_an_adder_hears_its_inputs_and_its_feedback_resistor():
    previous, next_ = 1 / built().resistors["s"][:, 1]
    feedback = 1 / built().feedback["s"]
    expected = [feedback + next_, *[feedback + previous + next_] * 2, feedback + previous]
    assert conductances()["ground.s"] == pytest.approx(expected)  # no resistor beyond the ends


def test_an_integrator_hears_its_inputs():
    expected = (1 / built().resistors["x"]).sum(axis=0)
    assert conductances()["ground.x"] == pytest.approx(expected)


def test_an_inverter_hears_two_resistors():
    circuit = built()
    (name,) = circuit.schematic.inverted
    assert conductances()[f"inverter.{name}"] == pytest.approx(2 / circuit.inverter)


def test_nothing_is_heard_where_nothing_is():
    network = chain()
    short = replace(network, omitted=(Omitted(neuron="x", stage=3),))
    scaling = scale(short, ProbeRun(states=np.ones((1, short.size)), times=np.zeros(1), radius=2.0))
    found = {s.name: s.conductance for s in noise_sources(circuit_of(schematic_of(short), scaling))}
    assert found["ground.x"][3] == 0
    assert found["ground.s"][2] == pytest.approx(found["ground.s"][3])  # x of cell 3 is not there


def test_circuits_without_such_op_amps_are_refused():
    with pytest.raises(NetworkError, match="single-ended"):
        noise_sources(built(differential=True))


# ---- samples -------------------------------------------------------------------------------------


def test_samples_have_the_density_that_is_asked_for():
    """The integral of white noise of one-sided density S over T has the variance S T / 2."""
    density, step, count = 3e-24, 2e-9, 100
    samples = white(density, step, 4000 * count, [1]).reshape(4000, count)
    integrals = np.trapezoid(samples, dx=step, axis=1)
    expected = density * (count - 1) * step / 2
    assert integrals.var() == pytest.approx(expected, rel=0.05)  # 2.2 % is a standard deviation


def test_the_size_of_samples_is_that_of_the_resistors():
    currents = draw_noise(built(), NANOSECONDS, 400e-6)
    for source, samples in zip(currents.sources, currents.samples):
        density = 4 * BOLTZMANN * 300 * source.conductance
        assert samples.std(axis=1) == pytest.approx(np.sqrt(density / 20e-9), rel=0.02)


def test_amplifier_noise_is_a_voltage_over_the_resistors():
    currents = draw_noise(built(), replace(NANOSECONDS, temperature=0, amplifier=5e-9), 400e-6)
    for source, samples in zip(currents.sources, currents.samples):
        expected = 5e-9 * source.conductance / np.sqrt(20e-9)
        assert samples.std(axis=1) == pytest.approx(expected, rel=0.02)


def test_noise_begins_at_zero_and_lasts():
    currents = draw_noise(built(), NANOSECONDS, 101e-9)
    assert currents.samples.shape == (len(currents.sources), 4, 12)
    assert currents.span == pytest.approx(110e-9)
    assert (currents.samples[:, :, 0] == 0).all()
    assert (currents.samples[:, :, 1:] != 0).all()


def test_the_same_seed_gives_the_same_noise():
    once, twice, other = (
        draw_noise(built(), replace(NANOSECONDS, seed=seed), 10e-6).samples for seed in (3, 3, 4)
    )
    assert (once == twice).all()
    assert abs(np.corrcoef(once.ravel(), other.ravel())[0, 1]) < 0.05


def test_sources_are_independent():
    samples = draw_noise(built(), NANOSECONDS, 50e-6).samples[:, :, 1:]
    correlation = np.corrcoef(samples.reshape(-1, samples.shape[2]))
    assert np.abs(correlation - np.eye(len(correlation))).max() < 0.07  # 5000 samples


def test_a_longer_run_begins_the_same():
    short, long = (draw_noise(built(), NANOSECONDS, span).samples for span in (1e-6, 2e-6))
    assert (long[:, :, : short.shape[2]] == short).all()


def test_another_part_leaves_the_streams_of_the_others():
    assert {s.name for s in noise_sources(built())} < {s.name for s in noise_sources(built(True))}
    few, many = draw_noise(built(), NANOSECONDS, 1e-6), draw_noise(built(True), NANOSECONDS, 1e-6)
    for source in few.sources:
        a, b = few[source.name][:, 1:], many[source.name][:, 1:]
        assert b / a == pytest.approx(np.broadcast_to(b[:, :1] / a[:, :1], a.shape))


def test_noise_grows_with_the_root_of_the_temperature():
    warm, hot = (
        draw_noise(built(), replace(NANOSECONDS, temperature=t), 1e-6).samples for t in (300, 1200)
    )
    assert hot == pytest.approx(2 * warm)


def test_no_temperature_and_no_amplifier_noise_is_nothing():
    currents = draw_noise(built(), replace(NANOSECONDS, temperature=0), 1e-6)
    assert currents.sources == ()
    assert currents.samples.size == 0
    assert currents.span == pytest.approx(1e-6)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("temperature", -1.0),
        ("temperature", np.nan),
        ("amplifier", -1e-9),
        ("amplifier", np.inf),
        ("step", 0.0),
        ("step", -1e-9),
        ("step", np.inf),
        ("seed", -1),
        ("seed", 0.5),
    ],
)
def test_a_number_out_of_range_is_named(field, value):
    with pytest.raises((NetworkError, ArgumentError), match=field):
        replace(NANOSECONDS, **{field: value})


def test_a_span_has_to_be_positive():
    with pytest.raises(NetworkError, match="span"):
        draw_noise(built(), NANOSECONDS, 0.0)
