"""Diodes of diode neurons: how far they slow their op amps, in ngspice and by the closed form."""

import numpy as np
import pytest
from scipy.constants import Boltzmann, elementary_charge
from simulator import needs_ngspice

from ann_dc import SpiceBackend, emulate, equilibrium, evaluator, levels, spectrum
from ann_dc.backends.spice.circuit_run import refined
from ann_dc.backends.spice.ngspice.runner import Ngspice
from ann_dc.fidelity.prediction import predict
from ann_dc.hardware.emulation.building import emulate_clamps
from ann_dc.hardware.emulation.states import emulated_state, pole_spectrum
from ann_dc.network.cell import Cell, Connection, Function, Neuron, Sum
from ann_dc.network.duals import InequalityDual
from ann_dc.network.network import Network

MACRO = levels.macro()
SLOW = SpiceBackend(level=MACRO, bandwidth_margin=10.0)
DUAL = InequalityDual(neuron="z", residual="g", sum="y", multiplier="m")


def ringing(pull: float, x: str = "u.x") -> Network:
    """x' = pull - m, z' = m - z, m = max(0, z + 0.3 x): a ring that op amps keep for long."""
    ends = (
        ("one", x, pull), ("m", x, -1.0), (x, "g", 1.0),
        ("z", "y", 1.0), ("g", "y", 0.3), ("m", "z", 1.0), ("z", "z", -1.0),
    )  # fmt: skip
    cell = Cell(
        neurons=(Neuron(name=x), Neuron(name="z")),
        blocks=(Sum(name="g"), Sum(name="y"), Function(name="m", function="rectify", x="y")),
        connections=tuple(Connection(source=a, target=b, weight=c) for a, b, c in ends),
        inequality_duals=(DUAL,),
    )
    return Network(cell=cell, stages=1)


@needs_ngspice
@pytest.mark.parametrize("pull", [0.2, 1.0])
def test_what_rings_settles_as_predicted(pull):
    """Without drop and junction the prediction is 9 % early."""
    run = SLOW.run(ringing(pull))
    reported = predict(run.circuit, MACRO, run.probe)
    run = refined(run, Ngspice(), MACRO.datasheet)
    assert run.settling_time() == pytest.approx(reported.settling_time, rel=0.01)


@pytest.mark.parametrize("volts", [0.05, 0.2, 0.8])
def test_an_op_amp_moves_by_the_drop_of_its_diode_too(volts):
    circuit, _ = SLOW.prepare(ringing(1.0))
    emulation = emulate_clamps(circuit, MACRO)
    network, x = emulation.network, np.zeros(emulation.network.size)
    place = network.state_index[network.neuron_index["open.m"], 0]
    x[place] = volts * abs(circuit.value_of("m"))
    values = evaluator(network).values(x)[..., 1:-1]
    pace = float(values[network.node_index["pace.open.m"]][0])
    assert 1 / pace == pytest.approx(1 + 300 * Boltzmann / elementary_charge / volts, rel=0.12)
    x[place] *= -1
    values = evaluator(network).values(x)[..., 1:-1]
    assert float(values[network.node_index["pace.open.m"]][0]) == pytest.approx(1.0, abs=0.05)


@pytest.mark.parametrize("pull", [0.2, 1.0])
def test_modes_at_rest_are_those_of_the_transient(pull):
    circuit, probe = SLOW.prepare(ringing(pull))
    saturated, moving = emulate(circuit, MACRO), emulate_clamps(circuit, MACRO)
    x = emulated_state(saturated, probe.final)
    assert moving.network.neuron_index == saturated.network.neuron_index
    found, expected = pole_spectrum(saturated, probe.final), spectrum(moving.network, x)
    plain = spectrum(saturated.network, x)
    assert found.eigenvalues == pytest.approx(expected.eigenvalues, rel=1e-6)
    assert found.abscissa != pytest.approx(plain.abscissa, rel=1e-3)
    rest = equilibrium(saturated.network, x)
    assert equilibrium(moving.network, rest) == pytest.approx(rest, abs=1e-9)


@needs_ngspice
def test_a_network_without_controls_is_predicted_by_all_of_its_neurons():
    run = SLOW.run(ringing(1.0, "x"))
    reported = predict(run.circuit, MACRO, run.probe)
    assert reported.control_error == pytest.approx(run.control_error, abs=1e-4)
