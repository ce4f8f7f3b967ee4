"""What each parasitic moves by itself: all of them together move about the sum."""

import numpy as np
import pytest
from wired import neighbour_wired

from ann_dc.backends.spice.backend import SpiceBackend
from ann_dc.fidelity.boards.effects import systematic, with_parasitics
from ann_dc.fidelity.circuit_instance import CircuitInstance
from ann_dc.hardware.parts.levels import macro

GIVEN = {
    "multiplier_nonlinearity": 4e-3,
    "multiplier_feedthrough": 1e-4,
    "switch_leakage": 1e9,
    "bias_current": 1e-9,
}


def instance(**parasitics: float) -> CircuitInstance:
    level = with_parasitics(macro(), **parasitics)
    circuit, probe = SpiceBackend(level=macro()).prepare(neighbour_wired("car", 3))
    return CircuitInstance(circuit=circuit, level=level, probe=probe)


@pytest.mark.slow
def test_moves_are_those_of_each_alone_the_largest_first():
    moves = systematic(instance(**GIVEN, multiplier_noise=1e-6))
    assert set(moves) == set(GIVEN)
    assert list(moves.values()) == sorted(moves.values(), reverse=True)
    plain = instance()
    ideal = plain.emulation.controls(plain.settled)
    for name, value in GIVEN.items():
        alone = instance(**{name: value})
        move = np.abs(alone.emulation.controls(alone.settled) - ideal).max() / np.abs(ideal).max()
        assert moves[name] == pytest.approx(move, rel=1e-6)


@pytest.mark.slow
def test_no_circuit_is_further_off_than_its_moves_together():
    found = instance(**GIVEN)
    sum_of_all = sum(systematic(found).values()) + instance().control_error
    assert found.control_error < 1.02 * sum_of_all


@pytest.mark.slow
def test_capacitances_move_no_settled_point():
    moves = systematic(instance(switch_capacitance=5e-12, switch_charge=1e-12))
    assert max(moves.values()) < 1e-9
