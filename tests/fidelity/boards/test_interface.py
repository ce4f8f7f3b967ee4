"""Converters: rounded inputs and controls, time, and starts without sources."""

from functools import cache

import numpy as np
import pytest

from ann_dc import PreconditionerKind, SpiceBackend, design, plants
from ann_dc.errors import ArgumentError, NetworkError
from ann_dc.fidelity.boards.interface import Interface, interface_cost
from ann_dc.fidelity.prediction import predict
from ann_dc.hardware.parts.levels import BEHAVIOURAL, macro, switched_capacitor
from ann_dc.network.cell import Cell, Connection, Neuron
from ann_dc.network.network import Network

EXACT = Interface()


@cache
def built(plant="double_integrator"):
    network = design(plants.get(plant)(N=3), preconditioner=PreconditionerKind.DIAGONAL).network
    backend = SpiceBackend(level=macro())
    return backend, *backend.prepare(network)


def test_exact_converters_cost_nothing():
    found = interface_cost(*built(), EXACT)
    assert found.error < 1e-6
    assert found.rounded == {}
    assert (found.input_error, found.worst_input_error, found.output_error) == pytest.approx(
        (0.0, 0.0, 0.0), abs=1e-6
    )
    assert found.solve_time == found.settling_time


def test_a_linear_problem_answers_a_rounded_target_in_proportion():
    """Controls of the double integrator are linear in q_d.x, which alone is not zero."""
    backend, circuit, probe = built()
    found = interface_cost(backend, circuit, probe, Interface(dac_bits=8))
    step = 2 * circuit.scaling.unit["t.x"] / 2**8
    wanted = step * np.round(1.0 / step)
    assert found.rounded["q_d.x"] == pytest.approx(wanted)
    assert found.input_error == pytest.approx(abs(wanted - 1.0), rel=1e-3)
    assert found.error == pytest.approx(found.input_error)


def test_other_inputs_near_cost_no_more_than_the_bound():
    backend, circuit, probe = built()
    bound = interface_cost(backend, circuit, probe, Interface(dac_bits=8)).worst_input_error
    rng, network = np.random.default_rng(0), circuit.schematic.network
    steps = {"q_0.x": "t.x", "q_0.v": "t.v", "q_d.x": "t.x", "q_d.v": "t.v"}
    for _ in range(5):
        moved = {
            name: network.inputs[name] + rng.choice([-1, 1]) * circuit.scaling.unit[node] / 2**8
            for name, node in steps.items()
        }
        end = SpiceBackend(level=macro()).prepare(network.with_inputs(moved))[1]
        right = probe.control_values[-1]
        off = np.abs(end.control_values[-1] - right).max() / np.abs(right).max()
        assert off < 1.02 * bound


@pytest.mark.parametrize("bits", [6, 10])
def test_controls_are_read_within_half_a_step(bits):
    found = interface_cost(*built("pendulum"), Interface(adc_bits=bits))
    assert found.error <= found.output_error * (1 + 1e-6)
    assert found.error > found.output_error / 20
    finer = interface_cost(*built("pendulum"), Interface(adc_bits=bits + 1))
    assert finer.output_error == pytest.approx(found.output_error / 2)


def test_cells_whose_inputs_are_rounded_apart_cost_no_more_than_the_bound():
    """u = p_k - 0.9 p_(k-1): half steps of alternating signs move it by 1.9 of them."""
    wires = [
        Connection(source="u.a", target="u.a", weight=-1.0),
        Connection(source="p", target="u.a", weight=1.0),
        Connection(source="p", target="u.a", weight=-0.9, template=-1),
    ]
    cell = Cell(neurons=(Neuron(name="u.a"),), inputs=("p",), connections=tuple(wires))
    p = np.array([0.5, 0.2, -0.3, 0.4])
    row = Network(stages=4, cell=cell, inputs={"p": p})
    backend = SpiceBackend(level=macro())
    circuit, probe = backend.prepare(row)
    found = interface_cost(backend, circuit, probe, Interface(dac_bits=6))
    half = circuit.scaling.unit["p"] / 2**6
    largest = np.abs(probe.control_values[-1]).max()
    assert found.worst_input_error == pytest.approx(1.9 * half / largest, rel=1e-6)


def test_a_converter_of_one_bit_has_two_codes():
    backend, circuit, probe = built()
    found = interface_cost(backend, circuit, probe, Interface(dac_bits=1))
    step = circuit.scaling.unit["t.x"]
    values = np.concatenate([np.atleast_1d(v) for v in found.rounded.values()])
    assert set(np.round(values / step, 9)) <= {-1.0, 0.0}
    assert 0.5 < 1.0 / step < 1.0  # q_d.x is nearer to full scale, which has no code


def test_the_circuit_itself_enters_the_verdict():
    backend, circuit, probe = built()
    found = interface_cost(backend, circuit, probe, Interface(adc_bits=12))
    wanted = predict(circuit, backend.level, probe).control_error
    assert found.circuit_error == pytest.approx(wanted, rel=1e-9)
    worst = found.worst_input_error + found.output_error
    assert found.total_error == max(found.error, worst) + found.circuit_error


def test_a_circuit_that_oscillates_is_told():
    backend = SpiceBackend(level=macro(), bandwidth_margin=2.5)
    circuit, probe = backend.prepare(built()[1].schematic.network)
    found = interface_cost(backend, circuit, probe, Interface(dac_bits=12))
    assert np.isnan(found.circuit_error)
    assert np.isnan(found.total_error)
    assert np.isnan(found.settling_time)


def test_a_clocked_circuit_has_no_settling_time():
    network = built()[1].schematic.network
    backend = SpiceBackend(level=switched_capacitor(step=0.01, a0=1e6))
    with pytest.raises(
        NetworkError, match="interface: no settling time is known: it is not a network"
    ):
        interface_cost(backend, *backend.prepare(network), Interface(dac_bits=12))


def test_converters_take_time():
    slow = Interface(dac_bits=12, adc_bits=12, dac_settling=3e-6, adc_conversion=2e-6)
    assert slow.seconds == pytest.approx(5e-6)
    assert Interface(dac_bits=12, dac_settling=3e-6).seconds == pytest.approx(3e-6)


@pytest.mark.parametrize("plant", ["double_integrator", "pendulum"])
def test_circuits_settle_from_empty_capacitors(plant):
    found = interface_cost(*built(plant), EXACT)
    assert not found.other_equilibrium
    assert found.cold_settling_time == pytest.approx(found.settling_time, rel=0.3)


def test_bad_input_is_named():
    with pytest.raises(ArgumentError, match="dac_bits"):
        Interface(dac_bits=0)
    with pytest.raises(ArgumentError, match="adc_conversion"):
        Interface(adc_conversion=-1.0)
    _, circuit, probe = built()
    with pytest.raises(NetworkError, match="interface: behavioural circuits are not emulated"):
        interface_cost(SpiceBackend(level=BEHAVIOURAL), circuit, probe, EXACT)
