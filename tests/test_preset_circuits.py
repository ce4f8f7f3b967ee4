"""Boards of presets in ngspice: a fast one for CI, a sample of the bench marked slow."""

from dataclasses import replace

import numpy as np
import pytest
from bench import preset_circuits
from bench.preset_circuits import (
    BELOW,
    agree,
    below,
    board_of,
    compared,
    drawn,
    made,
    names_a_cure,
    network_of,
    spread,
)
from simulator import needs_ngspice
from wired import neighbour_wired

from ann_dc.errors import NetworkError
from ann_dc.fidelity.circuit_instance import CircuitInstance
from ann_dc.hardware.parts import presets

SAMPLE = ("unicycle", "river", "two_tanks", "cart")
QUICK = (5e-2, "zero_drift_trimmed")


@needs_ngspice
def test_a_board_with_all_that_its_parts_do_settles_as_predicted():
    network = neighbour_wired("double_integrator", 3)
    backend = board_of("tl072_ad633", network)
    assert backend.level.datasheet.parasitics.ground > 0
    circuit, probe = backend.prepare(network)
    nominal = CircuitInstance(circuit=circuit, level=backend.level, probe=probe)
    said, run = compared(backend, nominal)
    assert agree(said, run)
    assert run.settling_error < 0.01 * run.settling_time()
    assert not agree(replace(said, control_error=1.1 * said.control_error), run)
    assert not agree(replace(said, settling_time=0.9 * said.settling_time), run)


@pytest.mark.parametrize("ohms", [20.0, pytest.param(1e7, marks=pytest.mark.slow)])
def test_a_board_that_cannot_work_is_refused_with_what_would(ohms, monkeypatch):
    network = neighbour_wired("double_integrator", 5)
    board = board_of("opa192_ad734", network)
    asked = replace(board, level=replace(board.level, smallest_resistor=ohms))
    with pytest.raises(NetworkError, match="smallest_resistor") as refusal:
        asked.prepare(network)
    assert names_a_cure(str(refusal.value))
    monkeypatch.setattr(preset_circuits, "board_of", lambda *_: asked)
    row = made("double_integrator", "opa192_ad734", network)
    assert (row.value, row.remark, row.good) == ("refused", str(refusal.value), True)


def test_the_best_the_middle_and_the_worst_board_are_simulated():
    assert spread(np.array([0.3, np.nan, 0.1, 0.2, 0.4, 0.5])) == [2, 0, 5]
    assert spread(np.array([np.nan, 0.2, 0.1])) == [2, 1]
    assert spread(np.full(2, np.nan)) == []


@pytest.mark.slow
@needs_ngspice
@pytest.mark.parametrize("preset", presets.names())
@pytest.mark.parametrize("plant", SAMPLE)
def test_every_preset_settles_as_predicted(plant, preset):
    row = made(plant, preset, network_of(plant))
    assert row.good, row
    assert row.value != "refused", row


@needs_ngspice
@pytest.mark.parametrize(
    ("share", "preset"),
    [
        pytest.param(share, preset, marks=() if (share, preset) == QUICK else pytest.mark.slow)
        for share in BELOW
        for preset in presets.names()
    ],
)
def test_control_below_its_bound_errs_and_settles_as_predicted(share, preset):
    """Runs ended 10 % of an error of 2e-6 away from where they led."""
    row = made("regulator", preset, below(share))
    assert row.good, row
    assert row.value != "refused", row


@pytest.mark.slow
@needs_ngspice
@pytest.mark.parametrize("preset", presets.names())
def test_no_drawn_board_rings(preset):
    row = drawn("double_integrator", preset)
    assert row.good, row
