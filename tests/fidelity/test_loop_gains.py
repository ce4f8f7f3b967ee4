"""Loop gains of op amps: closed forms, the eigenvalues, and ngspice's small-signal analysis."""

import math
import re
from functools import cache

import numpy as np
import pytest
from simulator import needs_ngspice

from ann_dc.backends.spice.backend import SpiceBackend
from ann_dc.backends.spice.ngspice.runner import Ngspice
from ann_dc.errors import NetworkError
from ann_dc.evaluation.codegen.evaluator import fast_evaluator
from ann_dc.fidelity.boards.effects import with_parasitics
from ann_dc.fidelity.circuit_instance import CircuitInstance
from ann_dc.fidelity.circuit_study import study_circuit
from ann_dc.fidelity.loop_gains import loop_gains
from ann_dc.gain_design.procedure import design
from ann_dc.hardware.parts.levels import BEHAVIOURAL, macro, ota_c
from ann_dc.network.cell import ONE, Cell, Connection, Neuron
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.base import PreconditionerKind
from ann_dc.problem import plants
from ann_dc.solver import synthesize

GBW, A0 = 10e6, 1e6
LEVEL = macro(gbw=GBW, a0=A0)


def made(network: Network, level=LEVEL, bandwidth_margin: float = 10.0) -> CircuitInstance:
    circuit, probe = SpiceBackend(level=level, bandwidth_margin=bandwidth_margin).prepare(network)
    return CircuitInstance(circuit=circuit, level=level, probe=probe)


@cache
def plant(bandwidth_margin: float = 10.0, stages: int = 2) -> CircuitInstance:
    problem = plants.double_integrator(N=stages)
    return made(
        design(synthesize(problem), preconditioner=(PreconditionerKind.DIAGONAL,)).network,
        bandwidth_margin=bandwidth_margin,
    )


def loops_of(instance: CircuitInstance):
    return loop_gains(instance.emulation, instance.level, instance.settled)


# ---- closed forms --------------------------------------------------------------------------------


def test_a_leaking_integrator_by_hand():
    """x' = 1/2 - x: L = a(s) (s + w) / (s + g w), of two resistors and one capacitor."""
    wires = [Connection(source=s, target="x", weight=w) for s, w in (("x", -1.0), (ONE, 0.5))]
    row = Network(stages=1, cell=Cell(neurons=(Neuron(name="x"),), connections=tuple(wires)))
    instance = made(row)
    found = {loop.node: loop for loop in loops_of(instance)}["x"]
    s = 2j * np.pi * found.crossover * instance.circuit.scaling.time
    omega = 2 * np.pi * GBW * instance.circuit.scaling.time
    unit = instance.circuit.scaling.unit
    gamma = 1.0 + 0.5 * unit[ONE] / unit["x"]
    loop = omega / (s + omega / A0) * (s + 1) / (s + gamma)
    assert abs(loop) == pytest.approx(1, abs=1e-6)
    assert found.phase_margin == pytest.approx(np.degrees(np.angle(-loop)), abs=1e-6)


@pytest.mark.parametrize("pole", [100e6, 20e6])
def test_a_second_pole_lies_in_the_loop(pole):
    """The first pole held as a source, everything behind it solved for, and what comes back."""
    plain = plant()
    level = with_parasitics(LEVEL, second_pole=pole)
    instance = CircuitInstance(circuit=plain.circuit, level=level, probe=plain.probe)
    network, x = instance.emulation.network, instance.settled
    rates = network.layout.rates[tuple(network.places.T)]
    flow = rates[:, None] * fast_evaluator(network).drive_jacobian(x).toarray()
    omega = 2 * np.pi * GBW * instance.circuit.scaling.time
    names = [(network.cell.neurons[row].name, stage) for row, stage in network.places]
    for loop in loops_of(instance):
        s = 2j * np.pi * loop.crossover * instance.circuit.scaling.time
        i = names.index((f"first.{loop.node}", loop.stage))
        rest = np.delete(np.arange(network.size), i)
        behind = s * np.eye(len(rest)) - flow[np.ix_(rest, rest)]
        back = flow[i, i] + omega / A0 + flow[i, rest] @ np.linalg.solve(behind, flow[rest, i])
        broken = -back / (s + omega / A0)
        assert abs(broken) == pytest.approx(1, abs=1e-6)
        assert loop.phase_margin == pytest.approx(np.degrees(np.angle(-broken)), abs=1e-6)
    assert loops_of(instance)[0].crossover < GBW


def test_margins_shrink_as_op_amps_get_slower_against_the_network():
    worst = [
        loops_of(plant(bandwidth_margin))[0].phase_margin
        for bandwidth_margin in (20.0, 10.0, 6.0, 5.0)
    ]
    assert worst == sorted(worst, reverse=True)
    assert worst[0] > 60
    assert 0 < worst[-1] < 20


def test_they_are_sorted_and_each_op_amp_has_one():
    instance = plant()
    found = loops_of(instance)
    margins = [abs(loop.phase_margin) for loop in found]
    assert margins == sorted(margins)
    deck = SpiceBackend(level=LEVEL).deck(instance.circuit, instance.probe, {})
    assert len(found) == deck.parts["op amps"]
    assert len({(loop.node, loop.stage) for loop in found}) == len(found)


def test_what_has_no_op_amps_has_no_loops():
    level = ota_c()
    instance = made(plant().circuit.schematic.network, level)
    with pytest.raises(NetworkError, match="ota-c circuits have no op amps"):
        loop_gains(instance.emulation, level, instance.settled)


def test_a_study_lists_the_worst():
    network = plant().circuit.schematic.network
    study = study_circuit(network, SpiceBackend(level=LEVEL), loops=3, simulated=False)
    assert [str(loop) for loop in study.loops] == [str(loop) for loop in loops_of(plant())[:3]]
    assert study_circuit(network, SpiceBackend(level=LEVEL), simulated=False).loops == ()
    with pytest.raises(NetworkError, match="behavioural circuits are not emulated"):
        study_circuit(network, SpiceBackend(level=BEHAVIOURAL), loops=1, simulated=False)


# ---- ngspice -------------------------------------------------------------------------------------

POLE, OUTPUT_POLE = 1e-9, 2 * math.pi * GBW * 1e-9 / A0
"""Farads and siemens at the pole node of the macro model."""


def measured_margin(instance: CircuitInstance, node: str, stage: int) -> tuple[float, float]:
    """Crossover and phase margin by Blackman's formula: 1 + L = Z open / Z closed.

    A current into the pole node of the op amp finds the impedance there with its loop closed;
    open it is that of the model's own resistor and capacitor.
    """
    deck = SpiceBackend(level=instance.level).deck(instance.circuit, instance.probe, {})
    name = node.removeprefix("not.").replace(".", "_")
    prefix = "xn_" if node.startswith("not.") else "x_"
    inner = f"x_cell_{stage}.{prefix}{name}.xa.p"
    text = re.sub(r"(?m)^V_rst .*$", "V_rst rst 0 0", deck.text)
    text = re.sub(r"(?ms)^\.save .*?(?=^\.tran)", "", text)
    analysis = f"I_probe 0 {inner} ac 1\n.save v({inner})\n.ac dec 200 1e4 1e8"
    raw = Ngspice(timeout=60.0).run(re.sub(r"(?m)^\.tran .*$", analysis, text))
    hertz = np.real(raw["frequency"])
    loop = 1 / ((2j * np.pi * hertz * POLE + OUTPUT_POLE) * raw[inner]) - 1
    size = np.log(np.abs(loop))
    found = []
    for i in np.flatnonzero(np.sign(size[1:]) != np.sign(size[:-1])):
        share = size[i] / (size[i] - size[i + 1])
        angle = np.degrees(np.unwrap(np.angle(-loop[i : i + 2])))
        found.append((hertz[i] ** (1 - share) * hertz[i + 1] ** share, angle @ [1 - share, share]))
    return min(found, key=lambda pair: abs(pair[1]))


@needs_ngspice
@pytest.mark.parametrize("bandwidth_margin", [10.0, 6.0])
def test_ngspice_finds_the_same_margins_at_the_settled_point(bandwidth_margin):
    instance = plant(bandwidth_margin)
    for loop in (*loops_of(instance)[:4], loops_of(instance)[-1]):
        hertz, degrees = measured_margin(instance, loop.node, loop.stage)
        assert hertz == pytest.approx(loop.crossover, rel=0.01)
        assert degrees == pytest.approx(loop.phase_margin, abs=1.0)
