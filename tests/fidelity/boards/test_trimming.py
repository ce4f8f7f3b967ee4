"""Trimming: which parts first, what remains, and what drawn circuits say of it."""

from dataclasses import replace
from functools import cache
from importlib import import_module

import numpy as np
import pytest
from scipy.optimize import root_scalar

from ann_dc import PreconditionerKind, SpiceBackend, design, plants
from ann_dc.analysis.spectra import stability_limit
from ann_dc.errors import ArgumentError, NetworkError
from ann_dc.fidelity.boards.measurements import misread, reading_of
from ann_dc.fidelity.boards.trimming import Trimming, _trim_steps, trimming
from ann_dc.fidelity.circuit_instance import CircuitInstance
from ann_dc.fidelity.circuit_study import predicted_errors
from ann_dc.fidelity.error_budget import sensitivity
from ann_dc.fidelity.noise_run import control_noise
from ann_dc.hardware.circuit.circuit import Quantity
from ann_dc.hardware.parts import presets
from ann_dc.hardware.parts.datasheet import Tolerances
from ann_dc.hardware.parts.levels import BEHAVIOURAL, macro, switched_capacitor

GOOD = Tolerances(resistor=1e-4, offset=1e-3)
LARGE = {"double_integrator": 3, "pendulum": 3}


@cache
def network(plant):
    return design(
        plants.get(plant)(N=LARGE[plant]), preconditioner=PreconditionerKind.DIAGONAL
    ).network


@cache
def built(plant, tolerances):
    backend = SpiceBackend(level=macro(tolerances=tolerances))
    return backend, *backend.prepare(network(plant))


@cache
def procedure(error):
    return trimming(*built("double_integrator", GOOD), error, samples=30)


@pytest.mark.slow
def test_the_first_trim_is_the_part_that_costs_most():
    backend, circuit, probe = built("double_integrator", GOOD)
    first = procedure(4e-3).steps[0]
    costs = {}
    for parameter in circuit.parameters:
        if parameter.name.startswith("vos"):
            for stage in np.flatnonzero(parameter.present):
                off = np.zeros(circuit.schematic.network.stages)
                off[stage] = GOOD.offset
                found = CircuitInstance(
                    circuit=circuit,
                    level=backend.level,
                    probe=probe,
                    deviations={parameter.name: off},
                )
                costs[parameter.name, int(stage)] = found.control_error
    assert costs[first.parameter.name, first.stage] == pytest.approx(max(costs.values()), rel=0.05)


@pytest.mark.slow
def test_steps_stop_as_soon_as_enough_is_reached():
    found = procedure(4e-3)
    assert found.reached
    assert all(step.remaining > found.error for step in found.steps[:-1])
    assert len(found.steps) < len(procedure(1e-3).steps)


@pytest.mark.slow
def test_trimmed_circuits_are_as_right_as_predicted():
    found = procedure(4e-3)
    backend, circuit, probe = built("double_integrator", GOOD)
    assert found.before == pytest.approx(
        predicted_errors(circuit, backend.level, probe, range(30, 60)), rel=1e-12
    )
    assert np.quantile(found.before, 0.95) == pytest.approx(found.untrimmed, rel=0.4)
    assert np.quantile(found.after, 0.95) == pytest.approx(found.remaining, rel=0.4)


def test_what_resistors_cost_no_trim_takes_away():
    found = trimming(*built("double_integrator", Tolerances(resistor=1e-2)), 1e-4, samples=1)
    assert not found.reached
    assert found.steps == ()
    assert found.floor == found.untrimmed == found.remaining


def test_a_coarse_reading_leaves_more():
    backend, circuit, probe = built("double_integrator", GOOD)
    coarse = trimming(backend, circuit, probe, 1e-4, resolution=1e-3, samples=1)
    fine = trimming(backend, circuit, probe, 1e-4, resolution=1e-5, samples=1)
    assert coarse.floor > 3 * fine.floor


def test_what_is_less_than_the_noise_is_not_trimmed_for():
    backend, circuit, probe = built("double_integrator", GOOD)
    noise = control_noise(CircuitInstance(circuit=circuit, level=backend.level, probe=probe))
    with pytest.raises(
        NetworkError, match=r"trimming: noise of .* trimming cannot reduce the error below"
    ):
        trimming(backend, circuit, probe, 0.9 * noise, samples=1)


ERRORS = {
    Quantity.GAIN: 2e-2,
    Quantity.OFFSET_X: 4e-3,
    Quantity.OFFSET_Y: -3e-3,
    Quantity.OFFSET_Z: 5e-3,
}


def bench(level):
    """A nominal pendulum on a level, and a parameter of one of its parts by quantity."""
    backend = SpiceBackend(level=level)
    circuit, probe = backend.prepare(network("pendulum"))
    nominal = CircuitInstance(circuit=circuit, level=level, probe=probe)
    return nominal, {p.quantity: p for p in circuit.parameters if p.part == "m.omega*cos(theta)"}


def put_out(level, x, y, off):
    """An AD633 by its data sheet: its first input bent, and both fed through."""
    full, parasitics = level.full_scale, level.datasheet.parasitics
    x, y = x + off.get(Quantity.OFFSET_X, 0.0), y + off.get(Quantity.OFFSET_Y, 0.0)
    t = x / full
    bent = x + parasitics.multiplier_nonlinearity * full * (4 * t**3 - 3 * t)
    out = (1 + off.get(Quantity.GAIN, 0.0)) * bent * y / full + off.get(Quantity.OFFSET_Z, 0.0)
    return out + parasitics.multiplier_feedthrough * (x + y)


def read(level, quantity, off):
    """The measurement of a quantity, by hand."""
    full = level.full_scale

    def out(x, y):
        return put_out(level, x * full, y * full, off)

    if quantity is Quantity.GAIN:
        return (out(1, 1) - out(1, -1) - out(-1, 1) + out(-1, -1)) / 4
    if quantity is Quantity.OFFSET_X:
        return (out(0, 1) - out(0, -1)) / 2
    if quantity is Quantity.OFFSET_Y:
        return (out(1, 0) - out(-1, 0)) / 2
    return out(0, 0)


@pytest.mark.parametrize("quantity", ERRORS)
def test_a_multiplier_is_right_when_it_reads_what_it_is_set_to(quantity):
    """Trimmed by hand, with all its other errors as they are."""
    level = presets.get("tl072_ad633")
    nominal, parameters = bench(level)
    reading = reading_of(nominal, parameters[quantity], 0)
    assert reading.volts == pytest.approx(read(level, quantity, {}), rel=1e-12)
    wrong = misread(nominal, parameters[quantity], 0, ERRORS)
    assert wrong == pytest.approx(read(level, quantity, ERRORS) - reading.volts, rel=1e-9)
    left = root_scalar(
        lambda x: read(level, quantity, ERRORS | {quantity: x}) - reading.volts,
        bracket=(-0.1, 0.1),
    ).root
    assert abs(left) < 2e-2 * abs(ERRORS[quantity])  # products of two errors
    assert reading.spread == pytest.approx(
        level.tolerances.deviation(parameters[quantity].kind) * abs(reading.slope)
    )


def test_the_gain_of_a_function_generator_is_read_apart_from_its_offset():
    level = macro(tolerances=Tolerances(gain=1e-2, product_offset=2e-3))
    nominal, _ = bench(level)
    of_sine = {p.quantity: p for p in nominal.circuit.parameters if p.part == "sin(theta)"}
    gain, offset = (reading_of(nominal, of_sine[q], 1) for q in (Quantity.GAIN, Quantity.OFFSET_Y))
    assert gain.volts > 0
    assert gain.spread == pytest.approx(1e-2 * gain.volts)
    both = {Quantity.GAIN: 1e-2, Quantity.OFFSET_Y: 2e-3}
    wrong = misread(nominal, of_sine[Quantity.GAIN], 1, both)
    assert wrong == pytest.approx(1e-2 * gain.volts)
    wrong = misread(nominal, of_sine[Quantity.OFFSET_Y], 1, both)
    assert wrong == pytest.approx(2e-3 + 1e-2 * offset.volts)


def test_a_generator_gets_its_gain_before_its_offset():
    level = macro(tolerances=Tolerances(gain=1e-4, product_offset=2e-2))
    backend = SpiceBackend(level=level)
    found = trimming(backend, *backend.prepare(network("pendulum")), 1e-4, samples=5)
    order = [(step.parameter.part, step.stage, step.parameter.quantity) for step in found.steps]
    offsets = [each for each in order if each[0][3:] == "(theta)"]
    assert any(quantity is Quantity.OFFSET_Y for *_, quantity in offsets)
    for part, stage, quantity in offsets:
        if quantity is Quantity.OFFSET_Y:
            before = order.index((part, stage, Quantity.GAIN))
            assert before < order.index((part, stage, quantity))
    assert np.quantile(found.after, 0.95) == pytest.approx(found.remaining, rel=0.5)


def test_an_offset_of_an_op_amp_reads_nothing_when_there_is_none():
    nominal, _ = bench(macro(tolerances=Tolerances(offset=1e-3)))
    readings = {
        p.quantity: reading_of(nominal, p, int(np.flatnonzero(p.present)[0]))
        for p in nominal.circuit.parameters
        if p.kind.value == "offset"
    }
    assert {each.volts for each in readings.values()} == {0.0}
    assert readings[Quantity.OFFSET].spread == pytest.approx(1e-3)
    assert readings[Quantity.INVERTER_OFFSET].spread == pytest.approx(2e-3)


def test_a_circuit_that_oscillates_is_not_trimmed():
    backend = SpiceBackend(level=macro(tolerances=GOOD), bandwidth_margin=2.5)
    with pytest.raises(NetworkError, match="the pole model is unstable"):
        trimming(backend, *backend.prepare(network("double_integrator")), 5e-2, samples=2)
    row = network("double_integrator")
    level = switched_capacitor(step=1.5 * stability_limit(row, row.start_state), a0=1e6)
    backend = SpiceBackend(level=level)
    with pytest.raises(NetworkError, match="trimming: its equilibrium is unstable"):
        trimming(backend, *backend.prepare(row), 0.5, samples=2)


@pytest.mark.parametrize(
    ("settled", "count", "reached"),
    [(10, 10, True), (9, 10, False), (19, 20, True), (91, 100, False), (1, 1, True), (0, 1, False)],
)
def test_as_many_circuits_as_were_asked_for_keep_the_error(settled, count, reached):
    after = np.array([np.inf] * (count - settled) + [0.01] * settled)
    found = Trimming(
        error=0.05,
        share=0.95,
        untrimmed=0.03,
        floor=0.03,
        steps=(),
        places=0,
        noise=np.nan,
        before=after,
        after=after,
    )
    assert found.reached == reached


@pytest.mark.slow
@pytest.mark.parametrize(
    ("off", "wrong"),
    [
        ("vos", 0.5),
        pytest.param("vos", 2.0, marks=pytest.mark.slow),
        pytest.param("vos_m", 0.05, marks=pytest.mark.slow),
    ],
)
def test_where_slopes_are_wrong_emulated_circuits_say_how_much_is_trimmed(monkeypatch, off, wrong):
    """Slopes that are all off by a factor change little; those of the worst parts cost trims."""
    honest, module = procedure(4e-3), import_module("ann_dc.fidelity.boards.trimming")
    whole = module.sensitivity

    def misjudged(*given):
        found = whole(*given)
        slopes = {n: s * (wrong if n.startswith(off) else 1.0) for n, s in found.slopes.items()}
        return replace(found, slopes=slopes)

    monkeypatch.setattr(module, "sensitivity", misjudged)
    found = trimming(*built("double_integrator", GOOD), 4e-3, samples=30)
    assert found.reached
    assert found.kept.share >= found.share
    if off == "vos":
        assert abs(len(found.steps) - len(honest.steps)) <= 3
    else:
        assert len(found.steps) > len(honest.steps)


def test_slopes_are_of_the_circuits_that_are_emulated():
    """Seed by seed, where resistors cost as much as what is trimmed."""
    level = macro(tolerances=Tolerances(resistor=1e-3, offset=1e-4))
    backend = SpiceBackend(level=level)
    circuit, probe = backend.prepare(network("double_integrator"))
    nominal = CircuitInstance(circuit=circuit, level=level, probe=probe)
    slopes = sensitivity(nominal.emulation, nominal.settled)
    _, untrimmed = _trim_steps(nominal, slopes, 0.95, 1e-5)
    emulated = predicted_errors(circuit, level, probe, range(20))
    np.testing.assert_allclose(untrimmed[:20], emulated, rtol=0.02)


@pytest.mark.slow
def test_a_looser_spec_takes_no_more_trims():
    parts = Tolerances(resistor=5e-4, offset=1e-3)
    counts = []
    for error in (7e-3, 6e-3):  # the first one took more, when trims were doubled only
        found = trimming(*built("double_integrator", parts), error, samples=20)
        assert found.reached
        counts.append(len(found.steps))
    assert counts == sorted(counts)
    assert counts[0] > 0


def test_bad_input_is_named():
    backend, circuit, probe = built("double_integrator", GOOD)
    with pytest.raises(ArgumentError, match="error"):
        trimming(backend, circuit, probe, -1.0)
    with pytest.raises(NetworkError, match="trimming: behavioural circuits are not emulated"):
        trimming(SpiceBackend(level=BEHAVIOURAL), circuit, probe, 1e-2)
