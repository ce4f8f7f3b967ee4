"""Margins and intervals that suit a circuit; the smallest margin is tested with predictions."""

from dataclasses import replace

import numpy as np
import pytest
from preconditioner_networks import with_preconditioner
from wired import prepared

from ann_dc.backends.spice.backend import SpiceBackend
from ann_dc.fidelity.circuit_instance import CircuitInstance
from ann_dc.fidelity.error_budget import sensitivity, total_error
from ann_dc.fidelity.fitting import fitted, fitting_intervals, fitting_margin, smallest_margin
from ann_dc.hardware.parts.datasheet import Tolerances
from ann_dc.hardware.parts.levels import macro
from ann_dc.network.preconditioners.base import PreconditionerKind


@pytest.mark.slow
@pytest.mark.parametrize(
    "kind", [PreconditionerKind.MULTILEVEL, PreconditionerKind.CYCLIC_REDUCTION]
)
def test_a_preconditioner_asks_for_faster_op_amps(kind):
    circuit, probe = SpiceBackend(level=macro()).prepare(
        with_preconditioner("double_integrator", kind, 5)
    )
    bandwidth_margin = smallest_margin(circuit, macro(), probe)
    assert 1 < bandwidth_margin < 1000
    assert fitting_margin(circuit, macro(), probe) == 1.5 * bandwidth_margin


def test_without_a_preconditioner_the_usual_margin_fits():
    assert fitting_margin(*prepared_for_macro()) == pytest.approx(10, rel=0.25)


def prepared_for_macro():
    circuit, probe = prepared(False)
    return circuit, macro(), probe


def total_of(backend, network):
    """What `fitting_intervals` is to make small, by another way: of the circuit that is built."""
    circuit, probe = backend.prepare(network)
    built = CircuitInstance(circuit=circuit, level=backend.level, probe=probe)
    spread = backend.level.datasheet.tolerances
    if spread is None:
        return built.control_error
    return np.hypot(
        built.control_error, total_error(sensitivity(built.emulation, built.settled), spread)
    )


@pytest.mark.sampled(2)
@pytest.mark.parametrize("spread", [None, Tolerances(), Tolerances(offset=1e-3)])
@pytest.mark.parametrize(("name", "stages"), [("double_integrator", 5), ("unicycle", 4)])
def test_no_circuit_is_further_off_for_its_fitting_intervals(name, stages, spread):
    network = with_preconditioner(name, PreconditionerKind.DIAGONAL, stages)
    level = macro()
    level = replace(level, datasheet=replace(level.datasheet, tolerances=spread))
    backend = SpiceBackend(level=level)
    chosen = replace(backend, intervals=fitting_intervals(backend, network))
    assert total_of(chosen, network) <= total_of(backend, network)


def test_where_gain_is_all_that_is_wrong_wider_intervals_of_multipliers_are_better():
    network = with_preconditioner("double_integrator", PreconditionerKind.DIAGONAL, 5)
    backend = SpiceBackend(level=macro())
    chosen = replace(backend, intervals=fitting_intervals(backend, network))
    assert total_of(chosen, network) < 0.75 * total_of(backend, network)


def test_offsets_of_the_car_ask_for_all_of_the_scale():
    network = with_preconditioner("car", PreconditionerKind.DIAGONAL)
    level = macro()
    off = replace(level.datasheet, tolerances=Tolerances(offset=1e-3))
    backend = SpiceBackend(level=replace(level, datasheet=off))
    assert fitting_intervals(backend, network) == {}


def test_what_is_declared_is_kept():
    network = with_preconditioner("double_integrator", PreconditionerKind.DIAGONAL, 5)
    declared = {"mu.x": (-5000.0, 6000.0)}
    backend = SpiceBackend(level=macro(), intervals=declared, bandwidth_margin=12.0)
    chosen = fitted(backend, network)
    assert chosen.intervals["mu.x"] == declared["mu.x"]
    assert chosen.bandwidth_margin == 12.0
    assert len(chosen.intervals) > 1
