"""Resistors and capacitors compute the network's flow: currents, jumps, and the preconditioner."""

from functools import cache

import numpy as np
import pytest
from designs import near_start
from problems import SUITE

from ann_dc.backends.ode import DOP853, OdeBackend
from ann_dc.evaluation.reference import evaluator
from ann_dc.gain_design.gain_rule import DIAGONAL_RULE, MULTILEVEL_RULE
from ann_dc.gain_design.procedure import design
from ann_dc.hardware.circuit.circuit import circuit_of
from ann_dc.hardware.circuit.scaling import ProbeRun, scale
from ann_dc.hardware.parts.datasheet import SMALLEST_RESISTOR
from ann_dc.hardware.schematic.elements import Adder, Integrator, PICell
from ann_dc.hardware.schematic.preconditioner_wiring import preconditioner_values
from ann_dc.hardware.schematic.schematic import schematic_of
from ann_dc.network.network import Network
from ann_dc.solver import synthesize


@cache
def car(coordinated: bool) -> Network:
    gain_rule = MULTILEVEL_RULE if coordinated else DIAGONAL_RULE
    return design(synthesize(SUITE["car"].problem), gain_rule=gain_rule).network


@cache
def built(coordinated: bool):
    network = car(coordinated)
    run = OdeBackend(method=DOP853, verify=False).run(network).trajectory
    scaling = scale(network, ProbeRun(states=run.states, times=run.time, radius=2.0))
    return circuit_of(schematic_of(network), scaling)


def current_into(circuit, name: str, values: np.ndarray, wires) -> np.ndarray:
    """Amperes into a part's virtual ground (N,) from the voltages of all nodes."""
    scaling, network = circuit.scaling, circuit.schematic.network
    total = np.zeros(network.stages)
    for number, wire in enumerate(wires):
        row = network.node_index[wire.source]
        given = values[row, 1 + wire.offset : 1 + wire.offset + network.stages]
        # the sign with which the part reads its source makes w * p * sign negative
        volts = scaling.volts(wire.source, given) * np.sign(wire.weight)
        total -= circuit.schematic.polarity[name] * volts / circuit.resistors[name][number]
    return total


@pytest.mark.sampled(1)
@pytest.mark.parametrize("coordinated", [False, True])
def test_currents_of_integrators_are_the_flow(coordinated):
    circuit = built(coordinated)
    network, scaling = circuit.schematic.network, circuit.scaling
    x = near_start(network, 3)
    values = evaluator(network).values(x)
    drives = evaluator(network).drives(x)
    for part in circuit.schematic.parts:
        if not isinstance(part, Integrator):
            continue
        slope = (
            -current_into(circuit, part.name, values, part.wires) / circuit.capacitors[part.name]
        )
        wanted = drives[network.neuron_index[part.name.removeprefix("own.")]] * part.rate
        polarity = circuit.schematic.polarity[part.name]
        np.testing.assert_allclose(
            slope * polarity * scaling.time, scaling.volts(part.name, wanted), rtol=1e-9, atol=1e-9
        )


def test_a_pi_cell_is_residual_integrator_and_multiplier_in_one():
    circuit = built(False)
    network, scaling = circuit.schematic.network, circuit.scaling
    values = evaluator(network).values(near_start(network, 4))
    for part in circuit.schematic.parts:
        if not isinstance(part, PICell):
            continue
        residual = next(d.residual for d in network.cell.duals if d.multiplier == part.name)
        c = values[network.node_index[residual], 1:-1]
        live = part.rate > 0
        current = current_into(circuit, part.name, values, part.wires)[live]
        jump = -current * circuit.feedback[part.name] * circuit.schematic.polarity[part.name]
        rise = (
            -current / circuit.capacitors[part.name][live] * circuit.schematic.polarity[part.name]
        )
        np.testing.assert_allclose(
            jump, scaling.volts(part.name, (part.rho * c)[live]), rtol=1e-9, atol=1e-12
        )
        np.testing.assert_allclose(
            rise * scaling.time,
            scaling.volts(part.name, (part.rate * c)[live]),
            rtol=1e-9,
            atol=1e-12,
        )


def test_adders_of_a_preconditioner_are_the_preconditioner():
    """With the integrals behind a state, currents through the adders' resistors are that state."""
    circuit = built(True)
    network, scaling = circuit.schematic.network, circuit.scaling
    x = near_start(network, 5)
    nodes = {name: values[0] for name, values in preconditioner_values(network, x[None]).items()}
    nodes |= dict(zip(network.neuron_index, network.unpack(x)))
    nodes["one"] = np.ones(network.stages)
    for part in circuit.schematic.parts:
        if not (isinstance(part, Adder) and part.present is not None):
            continue
        for stage in np.flatnonzero(part.present):
            out = 0.0
            for wire, ohms in zip(part.wires, circuit.resistors[part.name][:, stage]):
                if wire.weight[stage]:
                    volts = scaling.volts(wire.source, nodes[wire.source][stage + wire.offset])
                    out += np.sign(wire.weight[stage]) * volts * circuit.feedback[part.name] / ohms
            wanted = scaling.volts(part.name, nodes[part.name][stage])
            assert out == pytest.approx(wanted, rel=1e-9, abs=1e-12)


@pytest.mark.parametrize("coordinated", [False, True])
def test_no_resistor_at_a_virtual_ground_is_smaller_than_allowed(coordinated):
    circuit = built(coordinated)
    smallest = min(r.min(initial=np.inf) for r in circuit.resistors.values())
    assert smallest == pytest.approx(SMALLEST_RESISTOR)
