"""Trimming: which parts first, what remains, and what drawn circuits say of it."""

from functools import cache

import numpy as np
import pytest

from ann_dc import Kind, SpiceBackend, design, plants
from ann_dc.errors import ArgumentError, NetworkError
from ann_dc.fidelity import Specimen, predicted_errors
from ann_dc.fidelity.boards import reading_of, trimming
from ann_dc.hardware.parts import BEHAVIOURAL, Tolerances, macro

GOOD = Tolerances(resistor=1e-4, offset=1e-3)
LARGE = {"double_integrator": 3, "pendulum": 3}


@cache
def network(plant):
    return design(plants.get(plant)(N=LARGE[plant]), kinds=[Kind.TIME_CONSTANTS]).network


@cache
def built(plant, tolerances):
    backend = SpiceBackend(level=macro(tolerances=tolerances))
    return backend, *backend.prepare(network(plant))


@cache
def procedure(error):
    return trimming(*built("double_integrator", GOOD), error, samples=30)


def test_the_first_trim_is_the_part_that_costs_most():
    backend, circuit, probe = built("double_integrator", GOOD)
    first = procedure(4e-3).steps[0]
    costs = {}
    for parameter in circuit.parameters:
        if parameter.name.startswith("vos"):
            for stage in np.flatnonzero(parameter.present):
                off = np.zeros(circuit.schematic.network.stages)
                off[stage] = GOOD.offset
                found = Specimen(
                    circuit=circuit,
                    level=backend.level,
                    probe=probe,
                    deviations={parameter.name: off},
                )
                costs[parameter.name, int(stage)] = found.control_error
    assert costs[first.parameter.name, first.stage] == pytest.approx(max(costs.values()), rel=0.05)


def test_steps_stop_as_soon_as_enough_is_reached():
    found = procedure(4e-3)
    assert found.reached
    assert all(step.remaining > found.error for step in found.steps[:-1])
    assert len(found.steps) < len(procedure(1e-3).steps)


def test_trimmed_circuits_are_as_right_as_predicted():
    found = procedure(4e-3)
    backend, circuit, probe = built("double_integrator", GOOD)
    assert found.before == pytest.approx(
        predicted_errors(circuit, backend.level, probe, range(30)), rel=1e-12
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
    coarse = trimming(backend, circuit, probe, 1e-5, resolution=1e-3, samples=1)
    fine = trimming(backend, circuit, probe, 1e-5, resolution=1e-5, samples=1)
    assert coarse.floor > 3 * fine.floor


def test_readings_are_those_of_the_part_alone():
    """An offset that is trimmed to its reading is none; a gain is measured at full scale."""
    sizes = Tolerances(offset=1e-3, gain=1e-2, product_offset=2e-3)
    backend, circuit, probe = built("pendulum", sizes)
    nominal = Specimen(circuit=circuit, level=backend.level, probe=probe)
    kinds = {}
    for parameter in circuit.parameters:
        if parameter.kind.value in ("offset", "gain", "product_offset"):
            stage = int(np.flatnonzero(parameter.present)[0])
            kinds[parameter.name[:3]] = reading_of(nominal, parameter, stage)
    assert kinds["vos"].volts == 0.0
    assert kinds["vos"].spread in (1e-3, 2e-3)
    gain = kinds["ge_"]
    assert gain.volts != 0.0
    assert gain.spread == pytest.approx(1e-2 * abs(gain.volts))


def test_bad_input_is_named():
    backend, circuit, probe = built("double_integrator", GOOD)
    with pytest.raises(ArgumentError, match="error"):
        trimming(backend, circuit, probe, -1.0)
    with pytest.raises(NetworkError, match="trimming: behavioural circuits are not emulated"):
        trimming(SpiceBackend(level=BEHAVIOURAL), circuit, probe, 1e-2)
