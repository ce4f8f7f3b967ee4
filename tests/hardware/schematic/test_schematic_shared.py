"""Neurons that all cells share, as parts: one for the row, on lines to every cell."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.optimize import brentq
from simulator import needs_ngspice

from ann_dc import SpiceBackend, emulate, equilibrium, levels, spectrum
from ann_dc.errors import NetworkError
from ann_dc.fidelity.circuit_instance import CircuitInstance
from ann_dc.fidelity.error_budget import sensitivity
from ann_dc.hardware.circuit.circuit import Quantity
from ann_dc.hardware.emulation.noise_currents import (
    Noise,
    Place,
    draw_noise,
    noise_sources,
    noisy_network,
)
from ann_dc.hardware.emulation.states import emulated_state
from ann_dc.hardware.schematic.buildable import check_buildable
from ann_dc.hardware.schematic.elements import Adder, Generator, Integrator
from ann_dc.network.cell import Cell, Connection, Function, Neuron, Sum
from ann_dc.network.network import Network

SENT, LEVEL = 0.3, levels.macro(a0=1e8)


def wire(source: str, target: str, weight=1.0) -> Connection:
    return Connection(source=source, target=target, weight=weight)


def row(drive) -> Network:
    r"""x_k' = d_k - x_k - tanh(y/2 + 1/5), and one y for all: y'/2 = 0.3 \sum x_k - y."""
    stages = len(drive)
    last = np.eye(stages)[-1]
    cell = Cell(
        neurons=(Neuron(name="x"), Neuron(name="y", tau=0.5, shared=True)),
        inputs=("d",),
        blocks=(Sum(name="half"), Function(name="bent", function="tanh", x="half")),
        connections=(
            wire("d", "x"), wire("x", "x", -1.0), wire("bent", "x", -1.0),
            wire("x", "y", SENT), wire("y", "y", -last),
            wire("y", "half", 0.5), wire("one", "half", 0.2),
        ),
    )  # fmt: skip
    return Network(cell=cell, stages=stages, inputs={"d": np.asarray(drive, float)})


def settled(drive) -> tuple[np.ndarray, float]:
    """x (N,) and y where such a row rests: one equation in y."""
    drive = np.asarray(drive, float)

    def left(y: float) -> float:
        return SENT * (drive - np.tanh(0.5 * y + 0.2)).sum() - y

    y = brentq(left, -100, 100, xtol=1e-14)
    return drive - np.tanh(0.5 * y + 0.2), y


def prepared(drive, level=LEVEL):
    return SpiceBackend(level=level).prepare(row(drive))


DRIVES = st.lists(st.floats(0.2, 2.0), min_size=1, max_size=30)


@pytest.mark.slow
@settings(max_examples=25)
@given(drive=DRIVES)
def test_a_row_of_op_amps_settles_where_its_network_does(drive):
    circuit, probe = prepared(drive)
    emulation = emulate(circuit, LEVEL)
    start = emulated_state(emulation, probe.final)
    x = emulation.network.unpack(equilibrium(emulation.network, start))
    own, common = settled(drive)
    index = emulation.network.neuron_index
    np.testing.assert_allclose(x[index["x"]], own, atol=1e-6)
    np.testing.assert_allclose(x[index["y"]], common, atol=1e-6 * len(drive))
    assert spectrum(emulation.network, start).abscissa < 0


def test_what_is_shared_stands_once():
    network = row([1.0, 2.0, 0.5, 0.7])
    circuit, _ = SpiceBackend(level=LEVEL).prepare(network)
    schematic = circuit.schematic
    assert schematic.shared == {"y", "half", "bent"}
    found = schematic.count(Integrator), schematic.count(Adder), schematic.count(Generator)
    assert found == (4 + 1, 1, 1)
    present = {p.name: p.present.tolist() for p in circuit.parameters if p.part == "y"}
    last = [False, False, False, True]
    assert present["r_y_0"] == [True] * 4  # every cell sends its own x
    assert present["r_y_1"] == present["c_y"] == present["vos_y"] == last


def test_a_netlist_has_two_lines_for_it():
    circuit, probe = prepared([1.0, 2.0, 0.5, 0.7, 1.5])
    deck = SpiceBackend(level=LEVEL).deck(circuit, probe, {})
    text = deck.text[deck.text.index("* ---- cells") :].replace("\n+ ", " ")
    assert deck.signals["y", 4] == "y__bus"
    assert [name for name, stage in deck.signals if stage != 4] == ["x"] * 4
    assert text.count(".subckt") == 2  # the last cell, and all others
    assert text.count("X_y s__y__bus y__bus rst integ") == 1
    assert deck.parts["op amps"] == 5 + 2 + len(circuit.schematic.inverted & {"y", "half"}) + 5 * (
        "x" in circuit.schematic.inverted
    )


@needs_ngspice
@pytest.mark.parametrize("level", [levels.BEHAVIOURAL, levels.macro(a0=1e6)])
def test_ngspice_settles_there(level):
    drive = [1.0, 2.0, 0.5, 0.7, 1.5]
    run = SpiceBackend(level=level).run(row(drive))
    own, common = settled(drive)
    x = run.trajectory.network.unpack(run.trajectory.states[-1])
    np.testing.assert_allclose(x[0], own, atol=1e-5)
    assert x[1, -1] == pytest.approx(common, abs=1e-5)


OFF = {"r_y_0": np.array([0.02, 0, 0, 0]), "r_y_1": 0.01, "vos_y": 1e-3, "rf_half": -0.01}


@needs_ngspice
@pytest.mark.parametrize("name", OFF)
def test_parts_that_are_off_move_it_as_foreseen(name):
    """One sender's resistor counts as one of all; linear, by Newton, and in ngspice."""
    level, off = levels.macro(a0=1e6), {name: np.broadcast_to(OFF[name], 4)}
    circuit, probe = prepared([1.0, 2.0, 0.5, 0.7], level)
    nominal, built = (
        CircuitInstance(circuit=circuit, level=level, probe=probe, deviations=d) for d in ({}, off)
    )
    moved = built.emulation.controls(built.settled) - nominal.emulation.controls(nominal.settled)
    found = sensitivity(nominal.emulation, nominal.settled).shift(off)
    largest = np.abs(nominal.emulation.controls(nominal.settled)).max()
    assert np.abs(moved).max() > 1e-4
    np.testing.assert_allclose(found * largest, moved, atol=0.05 * np.abs(moved).max())
    backend = SpiceBackend(level=level)
    run = backend.measure(circuit, backend.deck(circuit, probe, off), probe)
    measured = run.trajectory.states[-1] - probe.final
    wanted = built.emulation.controls(built.settled) - probe.final
    np.testing.assert_allclose(measured, wanted, atol=0.02 * np.abs(moved).max())


def test_its_virtual_ground_hears_all_senders():
    circuit, _ = prepared([1.0, 2.0, 0.5, 0.7])
    sources = {(s.part, s.place): s.conductance for s in noise_sources(circuit)}
    name = circuit.parameter_name("y", Quantity.INPUT, 0)
    assert name == "r_y_0"
    ohms = circuit.resistors["y"]
    heard = sources["y", Place.GROUND]
    assert heard[:3].tolist() == [0, 0, 0]
    assert heard[3] == pytest.approx((1 / ohms[0]).sum() + 1 / ohms[1, 3], rel=1e-12)
    alone = (1 / circuit.resistors["half"][:, 3]).sum() + 1 / circuit.feedback["half"]
    np.testing.assert_allclose(sources["half", Place.GROUND], [0, 0, 0, alone])


def test_a_current_into_its_line_moves_it():
    """A steady current I shifts the sum that y integrates by I R of what an ohm is there."""
    level = levels.macro(a0=1e8)
    circuit, probe = prepared([1.0, 2.0, 0.5, 0.7], level)
    emulation = emulate(circuit, level)
    noise = Noise(step=1e-9, amplifier=1e-9)
    noisy = noisy_network(emulation, draw_noise(circuit, noise, 1e-8))
    ampere = np.array([0.0, 0.0, 0.0, 1e-7])
    moved = noisy.with_inputs({"noise.ground.y": ampere})
    start = emulated_state(emulation, probe.final)
    y = [
        network.unpack(equilibrium(network, start))[network.neuron_index["y"], -1]
        for network in (noisy, moved)
    ]
    volts = 1e-7 * circuit.resistors["y"][1, 3]  # y's own resistor: -y + sum + I R = 0
    change = -volts * circuit.value_of("y")
    slope = 1 + 4 * SENT * 0.5 * (1 - np.tanh(0.5 * y[0] + 0.2) ** 2)
    assert y[1] - y[0] == pytest.approx(change / slope, rel=1e-3)


@pytest.mark.parametrize(
    "level", [levels.ota_c(), levels.macro(differential=True), levels.switched_capacitor(step=0.01)]
)
def test_levels_without_such_lines_refuse_by_name(level):
    with pytest.raises(NetworkError, match=f"y: a neuron shared .* level {level.name}"):
        check_buildable(row([1.0, 2.0]), level)
    with pytest.raises(NetworkError, match="y: a neuron shared"):
        SpiceBackend(level=level).prepare(row([1.0, 2.0]))
