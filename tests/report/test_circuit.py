"""Words of a circuit's table: its parts, and what they cost."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from rich.console import Console

from ann_dc import PreconditionerKind, SpiceBackend, design, plants
from ann_dc.fidelity.circuit_study import study_circuit
from ann_dc.hardware.parts import presets
from ann_dc.hardware.parts.datasheet import Datasheet, Tolerances
from ann_dc.hardware.parts.e_series import E12
from ann_dc.hardware.parts.levels import macro
from ann_dc.report.circuit import CircuitReport


@cache
def problem(with_limits=False):
    free = plants.double_integrator(N=4)
    return replace(free, bounds={"a": (-60, 60)}) if with_limits else free


@cache
def network(with_limits=False):
    return design(problem(with_limits), preconditioner=PreconditionerKind.DIAGONAL).network


def words(backend, with_limits=False, samples=0):
    found = study_circuit(network(with_limits), backend, samples=samples, simulated=False)
    report = CircuitReport(problem=problem(with_limits), backend=backend, found=found)
    console = Console(width=300)
    with console.capture() as said:
        console.print(*report.tables())
    return found, said.get()


@pytest.mark.parametrize("with_limits", [False, True])
def test_a_bill_has_the_parts_of_rails(with_limits):
    _, said = words(SpiceBackend(level=macro()), with_limits)
    assert ("clamps: --bom" in said) == with_limits


def test_how_far_a_series_is_off_is_told_of_resistors_and_capacitors():
    backend = SpiceBackend(level=macro(), series=E12)
    found, said = words(backend)
    off = backend.deviations(found.circuit)
    largest = {
        letter: max(np.abs(each).max() for name, each in off.items() if name.startswith(letter))
        for letter in "rc"
    }
    assert found.series_rounding == pytest.approx(
        {"resistor": largest["r"], "capacitor": largest["c"]}, rel=1e-12
    )
    assert f"E12: rounding errors up to {largest['r']:.2%}" in said
    assert f"capacitors of E12: {largest['c']:.2%}" in said
    assert "use pairs, or exact values" in found.shortcoming


def test_noise_counts_with_every_drawn_circuit():
    """At a full scale of 10 uV none of them is within 1 %, however right its parts are."""
    level = macro(tolerances=Tolerances(resistor=1e-4))
    _, said = words(SpiceBackend(level=level), samples=3)
    assert "3 of 3 within 1%, noise included" in said
    found, said = words(SpiceBackend(level=replace(level, full_scale=1e-5)), samples=3)
    assert found.samples.max() < 0.01 < found.noise
    assert "0 of 3 within 1%, noise included" in said


@pytest.mark.parametrize(("volts", "advised"), [(1.0, True), (12.0, False)])
def test_a_larger_full_scale_is_advised_where_parts_have_room(volts, advised):
    rails = Datasheet(a0=300.0, output_swing=14.5)
    found, _ = words(SpiceBackend(level=replace(macro(datasheet=rails), full_scale=volts)))
    assert found.shortcoming.startswith("the error of the controls is predicted to be")
    assert ("a larger full scale" in found.shortcoming) == advised


def test_what_parts_can_do_is_told_as_far_as_it_is_limited():
    sheet = Datasheet(a0=1e6, gbw=10e6, slew=20e6, output_swing=14.5)
    assert str(sheet) == "gain 1e+06, op amps 10 MHz, slew 20 MV/s, output swing 14.5 V"
    assert "multipliers" in str(presets.get("ad8065_ad835").datasheet)


def test_power_is_split_and_exact_capacitors_are_stated():
    found, said = words(SpiceBackend(level=presets.get("opa192_ad734")), samples=2)
    assert 0 < found.cost.loads < found.cost.power
    assert " W quiescent + " in said
    assert " W loads" in said
    assert "exact (no tolerance known)" in said
    sizes = Tolerances(resistor=1e-3, capacitor=0.02)
    _, said = words(SpiceBackend(level=macro(tolerances=sizes)), samples=2)
    assert "no tolerance known" not in said
