"""Smallest resistor and margin: what is given is obeyed, the rest keeps to what parts can do."""

import re
from dataclasses import replace

import numpy as np
import pytest
from wired import neighbour_wired

from ann_dc.analysis.spectra import Spectrum
from ann_dc.backends.spice.backend import SpiceBackend
from ann_dc.errors import NetworkError
from ann_dc.hardware.circuit.loads import heaviest
from ann_dc.hardware.circuit.scaling import MARGIN
from ann_dc.hardware.emulation import building, emulate
from ann_dc.hardware.parts import presets
from ann_dc.hardware.parts.datasheet import SMALLEST_RESISTOR, Datasheet
from ann_dc.hardware.parts.foundry import SKY130
from ann_dc.hardware.parts.levels import TRANSISTOR, Level, macro
from ann_dc.hardware.parts.parasitics import Parasitics
from ann_dc.hardware.schematic.elements import Adder, PICell
from ann_dc.hardware.sizing.bandwidth_margin import SPARE, is_stable, least_margin
from ann_dc.hardware.sizing.resistors import CURRENT, GROUND, SHARE, STIFF, two_digits

PLANTS = {"double_integrator": 4, "car": 3}


def level(*, farads: float = 0.0, ohms: float | None = None, full=1.0, **parasitics) -> Level:
    datasheet = Datasheet(a0=1e6, parasitics=Parasitics(**parasitics))
    return replace(
        macro(datasheet), smallest_capacitor=farads, smallest_resistor=ohms, full_scale=full
    )


def made(wanted: Level, name: str = "double_integrator", bandwidth_margin: float | None = None):
    """(circuit, probe, what was told of its sizes)."""
    reported: list[str] = []
    backend = SpiceBackend(
        level=wanted, bandwidth_margin=bandwidth_margin, progress=reported.append
    )
    circuit, probe = backend.prepare(neighbour_wired(name, PLANTS[name]))
    return circuit, probe, [line for line in reported if "resistors on the scale" in line]


BARE = replace(TRANSISTOR, datasheet=replace(TRANSISTOR.datasheet, parasitics=Parasitics()))


@pytest.mark.parametrize("wanted", [level(), level(bias_current=1e-9), BARE])
def test_parts_that_ask_for_nothing_get_the_usual_sizes(wanted):
    circuit, _, reported = made(replace(wanted, smallest_capacitor=0.0))
    assert circuit.inverter == (wanted.smallest_resistor or SMALLEST_RESISTOR)
    assert circuit.scaling.bandwidth_margin == MARGIN
    assert not reported


def test_gates_of_the_smallest_transistors_leave_sizes_as_they_are():
    circuit, _, _ = made(TRANSISTOR)
    assert (circuit.inverter, circuit.scaling.bandwidth_margin) == (100e3, MARGIN)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", PLANTS)
@pytest.mark.parametrize("farads", [20e-12, 47e-12, 470e-12])
def test_capacitors_are_as_large_as_asked_for_and_no_larger_than_need_be(name, farads):
    circuit, _, reported = made(level(farads=farads), name)
    smallest = circuit.ranges[1][0]
    assert farads * (1 - 1e-9) <= smallest < 1.15 * farads  # sizes have two digits
    if circuit.scaling.bandwidth_margin > MARGIN:  # resistors cannot be smaller
        assert heaviest(circuit).amperes > 0.85 * SHARE * CURRENT
        times = circuit.scaling.bandwidth_margin / MARGIN
        assert f"{times:.3g} times slower than at margin 10" in reported[0]
    else:
        assert "slower" not in reported[0]
    assert heaviest(circuit).amperes < SHARE * CURRENT


def test_a_known_output_current_counts_instead_of_the_usual_one():
    strong, _, _ = made(level(farads=1e-8, output_current=0.1))
    weak, _, _ = made(level(farads=1e-8, output_current=5e-3))
    assert 0.8 * 0.1 * SHARE < heaviest(strong).amperes < 0.1 * SHARE
    assert 0.8 * 5e-3 * SHARE < heaviest(weak).amperes < 5e-3 * SHARE
    assert weak.scaling.bandwidth_margin / strong.scaling.bandwidth_margin == pytest.approx(
        20, rel=0.1
    )


@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", PLANTS)
@pytest.mark.parametrize("farads", [8e-12, 20e-12])
def test_a_capacitance_at_grounds_gets_resistors_with_which_nothing_rings(name, farads):
    wanted = level(input_capacitance=farads)
    circuit, probe, _ = made(wanted, name)
    assert is_stable(circuit.slower(1 / SPARE), wanted, probe.final)
    assert circuit.inverter < SMALLEST_RESISTOR
    corner = np.pi * 1e7 * farads * circuit.inverter  # of an inverter: two resistors
    assert corner <= GROUND
    rough, _, _ = made(
        replace(wanted, smallest_resistor=SMALLEST_RESISTOR), name, bandwidth_margin=10.0
    )
    if farads > 10e-12:
        assert not is_stable(rough, wanted, probe.final)  # which is why


def corners(circuit, farads: float, gbw: float) -> list[float]:
    """Of every virtual ground with a resistor as feedback: bandwidth over its corner."""
    schematic, found = circuit.schematic, [np.pi * gbw * farads * circuit.inverter]
    for part in schematic.parts:
        for stage in range(schematic.network.stages):
            if isinstance(part, (PICell, Adder)) and schematic.alive(part.name, stage):
                ohms = [*circuit.resistors[part.name][:, stage], circuit.feedback[part.name]]
                found.append(2 * np.pi * gbw * farads / sum(1 / each for each in ohms))
    return found


@pytest.mark.parametrize("name", PLANTS)
def test_grounds_of_parts_that_are_there_decide_and_of_no_others(name):
    circuit, _, _ = made(level(input_capacitance=8e-12), name)
    slowest = max(corners(circuit, 8e-12, 10e6))
    assert 0.9 * GROUND < slowest <= GROUND  # resistors have two digits


def test_no_resistor_is_smaller_than_ten_output_resistances():
    parasitics = Parasitics(input_capacitance=50e-12)
    soft = macro(Datasheet(a0=1e6, rout=100.0, parasitics=parasitics))
    circuit, _, _ = made(soft)
    assert circuit.inverter == STIFF * 100.0
    assert max(corners(circuit, 50e-12, 10e6)) > GROUND


def test_resistors_that_are_given_are_kept_and_the_margin_grows_until_nothing_rings():
    wanted = level(input_capacitance=20e-12, ohms=SMALLEST_RESISTOR)
    circuit, probe, reported = made(wanted)
    assert circuit.inverter == SMALLEST_RESISTOR
    least = least_margin(circuit, wanted, probe.final)
    assert 10 < least < circuit.scaling.bandwidth_margin <= 1.1 * SPARE * least
    assert "times slower" in reported[0]
    for share, stable in ((0.97, False), (1.03, True)):
        near = circuit.slower(share * least / circuit.scaling.bandwidth_margin)
        assert is_stable(near, wanted, probe.final) == stable


def test_small_capacitors_between_resistors_that_are_given_are_told_of_with_their_cost():
    circuit, _, reported = made(level(farads=47e-12, ohms=SMALLEST_RESISTOR))
    assert circuit.scaling.bandwidth_margin == MARGIN
    smallest = circuit.ranges[1][0]
    assert smallest < 47e-12
    assert (
        f"use resistors {47e-12 / smallest:.3g} times smaller, or a margin as many" in reported[0]
    )


def test_a_margin_that_is_given_is_kept():
    circuit, _, reported = made(level(farads=2e-9), bandwidth_margin=12.0)
    assert circuit.scaling.bandwidth_margin == 12.0
    assert circuit.ranges[1][0] < 2e-9
    assert "for the 2e-09 F of parasitic capacitance" in reported[0]


def test_what_is_given_and_rings_is_refused_with_what_would_not():
    wanted = level(input_capacitance=20e-12, ohms=SMALLEST_RESISTOR)
    network = neighbour_wired("double_integrator", 4)
    circuit, probe, _ = made(wanted)
    least = least_margin(circuit, wanted, probe.final)
    meant = r"unstable .*margin 10; raise the margin to (?P<margin>\S+) or more, or use a "
    meant += r"smallest_resistor of (?P<ohms>\S+) ohm, for the 2e-11 F at every virtual ground"
    with pytest.raises(NetworkError, match=meant) as refusal:
        SpiceBackend(level=wanted, bandwidth_margin=10.0).run(network)
    found = re.search(meant, str(refusal.value))
    assert least <= float(found["margin"]) < 1.1 * least
    cured = replace(wanted, smallest_resistor=float(found["ohms"]))
    assert is_stable(made(cured, bandwidth_margin=10.0)[0], cured, probe.final)


def test_resistors_that_are_given_and_too_small_for_the_op_amps_are_refused():
    wanted = level(output_current=1e-4, ohms=SMALLEST_RESISTOR)
    with pytest.raises(
        NetworkError, match=r"^smallest_resistor: with 1e\+04 ohm the op amp of "
    ) as e:
        made(wanted)
    ohms = float(str(e.value).partition("; use ")[2].split()[0])
    circuit, _, _ = made(replace(wanted, smallest_resistor=ohms))
    assert heaviest(circuit).amperes <= SHARE * 1e-4


def test_no_margin_at_all_is_told(monkeypatch):
    grows = Spectrum(eigenvalues=np.array([1.0]))
    monkeypatch.setattr("ann_dc.hardware.sizing.bandwidth_margin.pole_spectrum", lambda *_: grows)
    with pytest.raises(NetworkError, match=r"^smallest_resistor: with .* no margin makes the circ"):
        made(level(input_capacitance=20e-12))


def test_presets_keep_strays_small_on_boards():
    for name in presets.names():
        assert presets.get(name).smallest_capacitor == 47e-12
    assert macro().smallest_capacitor == 0
    assert TRANSISTOR.smallest_capacitor == SKY130.smallest_capacitor == 0.5e-12


@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", PLANTS)
@pytest.mark.parametrize("farads", [20e-12, 40e-12])
def test_chosen_margin_is_first_one_of_two_digits_with_a_stable_circuit_at_two_thirds(name, farads):
    wanted = level(input_capacitance=farads, ohms=SMALLEST_RESISTOR)
    circuit, probe, _ = made(wanted, name)
    bandwidth_margin = circuit.scaling.bandwidth_margin
    before = two_digits(bandwidth_margin * (1 - 1e-3))
    for value, stable in ((before, False), (bandwidth_margin, True)):
        spared = circuit.slower(value / SPARE / bandwidth_margin)
        assert is_stable(spared, wanted, probe.final) == stable


@pytest.mark.sampled(1)
@pytest.mark.parametrize("name", PLANTS)
def test_run_with_margin_search_emulates_few_circuits_and_run_without_search_one(name, monkeypatch):
    emulated = []

    def counted(*args, **options):
        emulated.append(args)
        return build(*args, **options)

    build = building._emulated
    monkeypatch.setattr(building, "_emulated", counted)
    wanted = level(input_capacitance=20e-12, ohms=SMALLEST_RESISTOR)
    network, counts = neighbour_wired(name, PLANTS[name]), []
    for bandwidth_margin in (None, 100.0):
        emulated.clear()
        backend = SpiceBackend(level=wanted, bandwidth_margin=bandwidth_margin)
        circuit, probe = backend.prepare(network)
        backend.check_stable(emulate(circuit, wanted, {}), probe)
        backend.deck(circuit, probe, {})
        counts.append(len(emulated))
    assert 2 < counts[0] <= 6
    assert counts[1] == 1
