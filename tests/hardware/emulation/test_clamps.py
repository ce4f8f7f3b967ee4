"""Clamps of rails: followers and walls where a circuit rests, op amps and diodes on its way."""

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.constants import e, k, zero_Celsius
from simulator import needs_ngspice

from ann_dc import OdeBackend, ode
from ann_dc.analysis.spectra import spectrum
from ann_dc.backends.spice.backend import SpiceBackend
from ann_dc.backends.spice.circuit_run import CircuitRun, refined
from ann_dc.backends.spice.ngspice.runner import Ngspice
from ann_dc.backends.spice.probe import span_of
from ann_dc.fidelity.circuit_instance import CircuitInstance
from ann_dc.fidelity.prediction import predict
from ann_dc.hardware.circuit.circuit import CLAMP_RESTING, CLAMP_SATURATION
from ann_dc.hardware.emulation.building import emulate_clamps
from ann_dc.hardware.emulation.emulation import Emulation
from ann_dc.hardware.parts import presets
from ann_dc.hardware.parts.datasheet import TYPICAL
from ann_dc.hardware.parts.levels import macro
from ann_dc.hardware.parts.parasitics import Parasitics
from ann_dc.network.cell import Cell, Connection, Limiter, Neuron
from ann_dc.network.network import Network
from ann_dc.resources import circuits_path


def wired(*ends: tuple[str, str, float]) -> tuple[Connection, ...]:
    return tuple(Connection(source=s, target=t, weight=w) for s, t, w in ends)


MARGIN = 60.0
INSIDE = {"x": (-3.2, 3.2), "y": (-3.2, 3.2)}


def oscillator(rail: float, leak: float = 0.03) -> Network:
    """Two neurons that turn around each other once in 2 pi, and come to rest slowly."""
    limits = Limiter(low=-rail, high=rail)
    cell = Cell(
        neurons=tuple(Neuron(name=name, limiter=limits) for name in "xy"),
        connections=wired(
            ("x", "x", -leak), ("y", "x", 1.0), ("y", "y", -leak), ("x", "y", -1.0),
            ("one", "y", 0.3),
        ),
    )  # fmt: skip
    return Network(stages=1, cell=cell)


def board_with(preset: str) -> SpiceBackend:
    """Of its parts, at a margin, whether it rings or not."""
    level = replace(presets.get(preset), full_scale=1.0)
    return SpiceBackend(
        level=level, bandwidth_margin=MARGIN, require_stable=False, intervals=INSIDE
    )


def growth(backend: SpiceBackend, network: Network) -> float:
    """Of the emulation, per unit of network time."""
    circuit, probe = backend.prepare(network)
    return CircuitInstance(circuit=circuit, level=backend.level, probe=probe).modes.abscissa


@pytest.mark.sampled(2)
@pytest.mark.parametrize("preset", ["opa828_ad734", "ad8065_ad835", "tl072_ad633"])
def test_clamps_that_are_off_damp_what_turns_by_what_they_lag(preset):
    """h = x - n s tau x' makes lambda = i - n s tau of lambda = i, to first order."""
    backend = board_with(preset)
    circuit, _ = backend.prepare(oscillator(3.0))
    sheet, T = backend.level.datasheet, circuit.scaling.time
    inside = sheet.rout * float(circuit.capacitors["x"][0]) / 5
    outside = (2 + sheet.rout * sheet.gbw / 20e9) / (2 * np.pi * sheet.gbw)
    damped = growth(backend, oscillator(3.0)) - growth(backend, oscillator(np.inf))
    assert damped == pytest.approx(-0.4 * (inside + outside) / T, rel=0.1)


def collecting(rail: float) -> Network:
    """A shared neuron that settles to 0.6, or its rail, by what three cells send to it."""
    decay = Connection(source="x", target="x", weight=np.array([0.0, 0.0, -1.0]))
    cell = Cell(
        neurons=(Neuron(name="x", shared=True, limiter=Limiter(high=rail)), Neuron(name="y")),
        inputs=("given",),
        connections=(*wired(("given", "y", 1.0), ("y", "y", -1.0), ("y", "x", 1.0)), decay),
    )
    return Network(stages=3, cell=cell, inputs={"given": [0.1, 0.2, 0.3]})


@pytest.mark.sampled(2)
@pytest.mark.parametrize("rout", [0.0, 50.0])
@pytest.mark.parametrize("rail", [0.5, 0.7, np.inf])
def test_emulated_shared_neuron_settles_as_all_cells_send(rail, rout):
    level = macro(rout=rout)
    circuit, probe = SpiceBackend(level=level).prepare(collecting(rail))
    instance = CircuitInstance(circuit=circuit, level=level, probe=probe)
    moved = OdeBackend(method=ode.RADAU, verify=False, limit=1e9).run(instance.moving.network)
    assert moved.status.settled
    for emulation, x in (
        (instance.emulation, instance.settled),
        (instance.moving, moved.trajectory.final),
    ):
        row = emulation.network.neuron_index["x"]
        assert emulation.network.unpack(x)[row, -1] == pytest.approx(min(rail, 0.6), rel=1e-4)


@pytest.mark.slow
@needs_ngspice
def test_a_board_that_swings_comes_to_rest_with_clamps():
    """Both as emulated: the same network without rails grows in ngspice, too."""
    backend = board_with("ad8065_ad835")
    for network, sign in ((oscillator(np.inf), 1), (oscillator(3.0), -1)):
        said, run = growth(backend, network), backend.run(network)
        assert np.sign(said) == sign
        assert envelope(run) == pytest.approx(said, abs=2e-3)


def envelope(run) -> float:
    """By what the logarithm of its swings grows, per unit of network time."""
    time, off = run.trajectory.time, np.abs(run.trajectory.states[:, 0] - run.probe.final[0])
    peaks = np.flatnonzero((off[1:-1] > off[:-2]) & (off[1:-1] > off[2:])) + 1
    peaks = peaks[(off[peaks] > 3e-3) & (off[peaks] < 0.9) & (time[peaks] > 1)]
    assert len(peaks) > 6
    return float(np.polyfit(time[peaks], np.log(off[peaks]), 1)[0])


def pressed(push: float) -> Network:
    """x' = push - x, between -1/2 and 1/2, and y' = x - y."""
    cell = Cell(
        neurons=(Neuron(name="x", limiter=Limiter(low=-0.5, high=0.5)), Neuron(name="y")),
        connections=wired(("x", "x", -1.0), ("one", "x", push), ("y", "y", -1.0), ("x", "y", 1.0)),
    )
    return Network(stages=1, cell=cell)


@pytest.mark.sampled(4)
@needs_ngspice
@pytest.mark.parametrize("farads", [0.0, 20e-12])
@pytest.mark.parametrize("push", [0.8, 1.4, -1.4])
def test_a_clamp_gives_way_to_what_presses(push, farads):
    """Of little gain, so that it shows: a diode's drop, and more the more it presses."""
    level = macro(a0=1e3, rout=50.0, parasitics=Parasitics(input_capacitance=farads))
    run = SpiceBackend(level=level).run(pressed(push))
    found = CircuitInstance(circuit=run.circuit, level=level, probe=run.probe)
    row = found.emulation.network.neuron_index["x"]
    said = found.emulation.network.unpack(found.settled)[row, 0] - np.sign(push) / 2
    assert abs(said) > 5e-4
    assert run.trajectory.final[0] - np.sign(push) / 2 == pytest.approx(said, rel=0.04)


def driven(
    *ends: tuple[str, str, float], rails: tuple[float, float], start: float = 0.0, tau: float = 2.0
) -> Network:
    """x' = ... - x between rails, and tau y' = -y, from 0 and a start of y."""
    cell = Cell(
        neurons=(
            Neuron(name="x", limiter=Limiter(low=rails[0], high=rails[1])),
            Neuron(name="y", tau=tau),
        ),
        connections=wired(("x", "x", -1.0), ("y", "y", -1.0), *ends),
    )
    return Network(stages=1, cell=cell).with_start(np.array([0.0, start]))


@pytest.mark.sampled(2)
@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize("apart", [0.05, 6e-3, 1.5e-3])
def test_what_rests_beside_a_rail_is_slower_by_the_diode_of_the_idle_clamp(apart, side):
    """1 + 2 s V_T / d times, to first order, as the drop of two diodes is 2 V_T ln d."""
    level = macro(gbw=1e9)
    circuit, _ = SpiceBackend(level=level, bandwidth_margin=1000).prepare(beside(apart, side))
    moving = emulate_clamps(circuit, level).network
    x = OdeBackend(verify=False, limit=1e6).run(moving).trajectory.final
    thermal = k * (zero_Celsius + 27) / e
    apart += 0.5 - side * moving.unpack(x)[moving.neuron_index["x"], 0]
    later = 1 + CLAMP_RESTING * thermal / 5 * abs(circuit.value_of("x")) / apart
    assert spectrum(moving, x).abscissa == pytest.approx(-1 / later, rel=0.02)


def beside(apart: float, side: int) -> Network:
    """x' = 1/2 - x, or -1/2 - x, with a rail beyond."""
    rails = (-np.inf, 0.5 + apart) if side > 0 else (-0.5 - apart, np.inf)
    return driven(("one", "x", side / 2), rails=rails, tau=0.1)


WAYS = {
    "pressed, and back": driven(
        ("one", "x", 0.1), ("y", "x", 3.0), rails=(-np.inf, 0.5), start=0.9
    ),
    "between two": driven(("one", "x", 0.1), ("y", "x", 3.0), rails=(-0.5, 0.5), start=0.9),
    "a lower rail": driven(("one", "x", 0.1), ("y", "x", -4.0), rails=(-0.3, 0.9), start=0.9),
    "from a rail": driven(("one", "x", 0.5), rails=(0.0, 0.8)),
    "beside a rail": driven(("one", "x", 0.495), rails=(-np.inf, 0.5)),
}


@pytest.mark.sampled(2)
@needs_ngspice
@pytest.mark.parametrize(
    "parts", [macro(), macro(gbw=3e6, rout=50.0, output_swing=4.0)], ids=["", "slow"]
)
@pytest.mark.parametrize("name", WAYS)
def test_clamps_move_as_in_ngspice(name, parts):
    """Those that are driven past their rails, too, by up to 0.8 V, where walls would hold."""
    run = SpiceBackend(level=parts).run(WAYS[name])
    found = CircuitInstance(circuit=run.circuit, level=parts, probe=run.probe)
    moved, walls = (way_of(emulation, run) for emulation in (found.moving, found.emulation))
    assert np.abs(moved).max() < 0.06
    assert np.abs(moved).max() < max(np.abs(walls).max() / 5, 3e-3)


def way_of(emulation: Emulation, run: CircuitRun) -> np.ndarray:
    """How far x is from where ngspice has it, over its run."""
    network = emulation.network
    trajectory = OdeBackend(verify=False, limit=1e6).run(network).trajectory
    column = trajectory.states[:, network.state_index[network.neuron_index["x"], 0]]
    found = np.interp(run.trajectory.time, trajectory.time, column)
    return found - run.trajectory.states[:, 0]


@pytest.mark.sampled(5)
@pytest.mark.parametrize("name", WAYS)
@pytest.mark.parametrize("cold", [False, True])
def test_clamps_that_move_come_to_rest_where_walls_hold(name, cold):
    """With offsets, and from empty capacitors."""
    level = macro(tolerances=replace(TYPICAL, offset=1e-3))
    backend = SpiceBackend(level=level, seed=3)
    circuit, probe = backend.prepare(WAYS[name])
    found = CircuitInstance(
        circuit=circuit, level=level, probe=probe, deviations=backend.deviations(circuit)
    )
    network = found.moving.network
    if cold:
        network = network.with_start(np.zeros(network.size))
    run = OdeBackend(verify=False, limit=1e6).run(network)
    settled = found.moving.controls(run.trajectory.final)
    np.testing.assert_allclose(settled, found.emulation.controls(found.settled), atol=1e-5)


def test_without_rails_nothing_moves():
    circuit, probe = SpiceBackend(level=macro()).prepare(driven(rails=(-np.inf, np.inf), start=0.5))
    found = CircuitInstance(circuit=circuit, level=macro(), probe=probe)
    assert found.moving is found.emulation


@pytest.mark.sampled(3)
@needs_ngspice
@pytest.mark.parametrize("gbw", [1e5, 1e7])
@pytest.mark.parametrize("below", [5e-4, 1e-2])
@pytest.mark.parametrize("side", [1, -1])
def test_neuron_that_rests_below_its_rail_is_off_and_settles_as_predicted(below, gbw, side):
    """One diode beside the output leaked 3 nA at 10 MHz, 1e-4 of full scale and more below it."""
    rail = 0.5 / (1 - below)
    rails = (-np.inf, rail) if side > 0 else (-rail, np.inf)
    level = macro(gbw=gbw, a0=1e5, slew=2 * gbw)
    backend = SpiceBackend(level=level, simulator=Ngspice())
    run = backend.run(driven(("one", "x", side / 2), rails=rails, tau=0.1))
    said = predict(run.circuit, level, run.probe)
    assert run.control_error == pytest.approx(said.control_error, rel=0.05)
    run = refined(run, backend.simulator, level.datasheet)
    assert run.settling_time() == pytest.approx(said.settling_time, rel=0.05)


@pytest.mark.parametrize("apart", [0.05, 1.5e-3])
def test_run_is_as_long_as_idle_clamps_ask_for(apart):
    """Its slowest time constant, 1, is 1 + 2 s V_T / d times as long."""
    level, network = macro(gbw=1e9), beside(apart, 1)
    circuit, probe = SpiceBackend(level=level, bandwidth_margin=1000).prepare(network)
    thermal = CLAMP_RESTING * k * (zero_Celsius + 27) / e
    later = 1 + thermal / 5 * abs(circuit.value_of("x")) / apart
    assert span_of(circuit, level, probe).wanted == pytest.approx(14 * later, rel=0.02)


def test_diodes_are_those_of_the_netlist():
    model = (circuits_path() / "models" / "macro" / "clamp.lib").read_text(encoding="utf-8")
    (card,) = re.findall(r"^\.model clamp_diode d\((.*)\)", model, re.M)
    given = dict(word.split("=") for word in card.split())
    assert float(given.pop("is")) == CLAMP_SATURATION
    assert given == {"cjo": "0.1p"}  # and an emission coefficient of one
    for clamp in model.split(".subckt")[1:]:
        assert (
            len(re.findall(r"^D\d", clamp, re.M)) == CLAMP_RESTING + 1
        )  # and the one that carries
