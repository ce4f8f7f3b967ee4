"""Capacitors and reset switches of a board are what Kirchhoff's laws say of them, by hand."""

from functools import cache
from itertools import product

import numpy as np
import pytest
from simulator import needs_ngspice

from ann_dc.backends.spice.backend import SpiceBackend, simulate
from ann_dc.backends.spice.netlist.timing import Simulation
from ann_dc.errors import NetworkError
from ann_dc.evaluation.reference import evaluator
from ann_dc.fidelity.prediction import predict
from ann_dc.gain_design.procedure import design
from ann_dc.hardware.circuit.circuit import circuit_of
from ann_dc.hardware.circuit.scaling import ProbeRun, ScalingRules, scale
from ann_dc.hardware.emulation.building import emulate
from ann_dc.hardware.emulation.nodes import AmplifierNodes
from ann_dc.hardware.parts.datasheet import Datasheet
from ann_dc.hardware.parts.levels import Level, macro, ota_c
from ann_dc.hardware.parts.parasitics import Parasitics
from ann_dc.hardware.schematic.schematic import schematic_of
from ann_dc.network.cell import Cell, Connection, Neuron, Sum
from ann_dc.network.duals import PIDual
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.base import PreconditionerKind
from ann_dc.problem import plants
from ann_dc.solver import synthesize

A0, GBW, LEAK, OPEN, ACROSS, CHARGE = 200.0, 1e6, 3e-3, 40e6, 7e-12, 2e-12
WORN = Parasitics(
    capacitor_leakage=LEAK, switch_leakage=OPEN, switch_capacitance=ACROSS, switch_charge=CHARGE
)


def integrator() -> Network:
    """0.5 x' = -2 x + 3, from 0.4."""
    wires = (
        Connection(source="x", target="x", weight=-2.0),
        Connection(source="one", target="x", weight=3.0),
    )
    cell = Cell(neurons=(Neuron(name="x", tau=0.5),), connections=wires)
    return Network(cell=cell, stages=1, start={"x": np.array([0.4])})


def dual() -> Network:
    """0.25 mu' = c and m = mu + 0.7 c, of an error c that comes from outside, from mu = -0.2."""
    cell = Cell(
        neurons=(Neuron(name="mu", tau=0.25),),
        inputs=("error",),
        blocks=(Sum(name="c"), Sum(name="m")),
        connections=(
            Connection(source="error", target="c", weight=0.8),
            Connection(source="c", target="mu"),
            Connection(source="mu", target="m"),
            Connection(source="c", target="m", weight=0.7),
        ),
        duals=(PIDual(neuron="mu", residual="c", multiplier="m"),),
    )
    start = {"mu": np.array([-0.2])}
    return Network(cell=cell, stages=1, inputs={"error": 0.3}, start=start)


PARTS = {"x": (integrator, 0.4), "m": (dual, -0.2)}
"""Each with its network, and where its capacitor is preset."""


def made(name: str, parasitics: Parasitics, off=(), *, differential: bool = False):
    """(Circuit, emulation) of a part."""
    network = PARTS[name][0]()
    states = np.linspace(0, 1.5, 5)[:, None] * np.ones(network.size)
    probe = ProbeRun(states=states, times=np.arange(5.0), radius=4.0)
    scaling = scale(network, probe, ScalingRules(gbw=GBW))
    circuit = circuit_of(schematic_of(network, differential=differential), scaling)
    parts = Datasheet(a0=A0, gbw=GBW, parasitics=parasitics)
    return circuit, emulate(circuit, Level(name="", models="ideal", datasheet=parts), dict(off))


@pytest.mark.parametrize("name", PARTS)
@pytest.mark.parametrize("error", [0.0, 0.3])
def test_what_flows_into_a_capacitor_leaks_and_charges_the_switch_too(name, error):
    """(C + C_s) h' = C (h' of ideal parts) - C h / tau - (h - h_0) / R_s, in seconds and volts."""
    off = {f"c_{name}": error}
    circuit, worn = made(name, WORN, off)
    _, ideal = made(name, Parasitics(), off)
    row = worn.network.neuron_index[AmplifierNodes(name).held]
    x = np.random.default_rng(0).standard_normal(worn.network.size)
    volt = circuit.value_of(name)
    h, before, after = (
        v[row] / volt for v in (x, evaluator(ideal.network).rhs(x), evaluator(worn.network).rhs(x))
    )
    farads = circuit.capacitors[name][0] * (1 + error)
    preset = PARTS[name][1] / volt
    leaks = circuit.scaling.time * (farads * h / LEAK + (h - preset) / OPEN)
    assert after * (farads + ACROSS) == pytest.approx(before * farads - leaks, rel=1e-12)


@pytest.mark.parametrize("name", PARTS)
def test_a_switch_leaves_its_charge_on_both_capacitors(name):
    circuit, emulation = made(name, WORN, {f"c_{name}": 0.3})
    row = emulation.network.neuron_index[AmplifierNodes(name).held]
    start = emulation.network.unpack(emulation.network.start_state)[row] / circuit.value_of(name)
    volts = CHARGE / (1.3 * circuit.capacitors[name] + ACROSS)
    assert start == pytest.approx(PARTS[name][1] / circuit.value_of(name) + volts, rel=1e-12)


@pytest.mark.parametrize("name", PARTS)
def test_charges_of_a_differential_circuit_cancel(name):
    _, emulation = made(name, Parasitics(switch_charge=CHARGE), differential=True)
    _, ideal = made(name, Parasitics(), differential=True)
    np.testing.assert_array_equal(emulation.network.start_state, ideal.network.start_state)


def test_cells_without_reset_switches_at_an_op_amp_are_named():
    parts = Datasheet(parasitics=Parasitics(switch_charge=CHARGE))
    with pytest.raises(NetworkError, match="parasitics, switch_charge: cells of leaky circuits"):
        Level(name="leaky", models="ideal", datasheet=parts, technology=ota_c().technology)


# ---- in ngspice ----------------------------------------------------------------------------------


@cache
def network(name: str) -> Network:
    problem = {"double_integrator": plants.double_integrator(N=5), "car": plants.car(N=9)}[name]
    return design(synthesize(problem), preconditioner=(PreconditionerKind.DIAGONAL,)).network


EFFECTS = {
    "capacitor leakage time constant 0.1 s": Parasitics(capacitor_leakage=0.1),
    "switches 1 Gohm": Parasitics(switch_leakage=1e9),
    "switches 5 pF": Parasitics(switch_capacitance=5e-12),
    "half a pC": Parasitics(switch_charge=0.5e-12),
    "all": Parasitics(
        capacitor_leakage=0.1, switch_leakage=1e9, switch_capacitance=5e-12, switch_charge=0.5e-12
    ),
}


QUICK = [("half a pC", "double_integrator", True)]
CASES = [
    case if case in QUICK else pytest.param(*case, marks=pytest.mark.slow)
    for case in product(EFFECTS, ("double_integrator", "car"), (False, True))
]


@needs_ngspice
@pytest.mark.parametrize(("effect", "name", "differential"), CASES)
def test_ngspice_finds_what_leaks_and_switches_were_to_do(effect, name, differential):
    parts = Datasheet(a0=1e6, parasitics=EFFECTS[effect])
    level = macro(parts, differential=differential)
    backend = SpiceBackend(level=level, simulation=Simulation(points=1000))
    circuit, probe = backend.prepare(network(name))
    found = predict(circuit, level, probe)
    run = simulate(backend, circuit, probe)
    assert found.control_error == pytest.approx(run.control_error, rel=0.02)
    assert found.settling_time == pytest.approx(run.settling_time(), rel=0.02)


def test_a_board_that_leaks_nothing_has_the_netlist_of_a_circuit_without():
    level = macro(Datasheet(a0=1e6, parasitics=Parasitics(multiplier_noise=1e-6)))
    plain = macro(Datasheet(a0=1e6))
    circuit, probe = SpiceBackend(level=plain).prepare(network("double_integrator"))
    decks = [SpiceBackend(level=each).deck(circuit, probe, {}).text for each in (plain, level)]
    assert decks[0] == decks[1]
