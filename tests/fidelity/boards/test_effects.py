"""The table of effects: the emulation says of each what ngspice does."""

import math
from dataclasses import replace

import numpy as np
import pytest
from by_hand import wired_by_hand
from simulator import needs_ngspice
from wired import neighbour_wired

from ann_dc.backends.spice.backend import SpiceBackend, simulate
from ann_dc.backends.spice.netlist.deck import deck_of
from ann_dc.errors import NetworkError, UnknownNameError
from ann_dc.fidelity.boards.effects import (
    Effect,
    Found,
    effects_table,
    known_effects,
    with_parasitics,
)
from ann_dc.fidelity.prediction import predict
from ann_dc.hardware.circuit.loads import heaviest
from ann_dc.hardware.circuit.scaling import MARGIN
from ann_dc.hardware.parts import presets
from ann_dc.hardware.parts.board_models import OP_AMPS
from ann_dc.hardware.parts.levels import macro
from ann_dc.hardware.sizing.bandwidth_margin import check_currents, is_stable
from ann_dc.hardware.sizing.resistors import SHARE
from ann_dc.network.network import Network

CLOSE = 0.05
"""Error and settling of emulation and ngspice."""


def agree(row: Found) -> None:
    """What is to settle does, as predicted; what is to ring is not seen to settle in its time."""
    assert row.predicted_stable is not None, row
    if not row.predicted_stable:
        assert row.measured_stable is not True, row
    else:
        assert row.measured_stable, row
        assert row.measured_error == pytest.approx(row.predicted_error, rel=CLOSE), row
        assert row.measured_settling == pytest.approx(row.predicted_settling, rel=CLOSE), row


def at_its_threshold(row: Found, network: Network) -> bool:
    """Whether 5 % of time decide if the emulation rings."""
    backend = SpiceBackend(level=row.effect.made_for, bandwidth_margin=MARGIN)
    circuit, probe = backend.prepare(network)
    ends = (circuit.slower(times) for times in (1 / (1 + CLOSE), 1 + CLOSE))
    faster, slower = (is_stable(end, row.effect.level, probe.final) for end in ends)
    return slower != faster


CHOSEN = ("no effect", "8 pF at every ground", "second pole at 1 GBW", "bias current 100 nA")


@needs_ngspice
def test_emulation_and_ngspice_agree_on_small_circuits():
    looked_at = [effect for effect in known_effects() if effect.words in CHOSEN]
    assert len(looked_at) == len(CHOSEN)
    reported: list[str] = []
    network = neighbour_wired("double_integrator", 3)
    rows = effects_table(network, looked_at, progress=reported.append)
    for row in rows:
        agree(row)
        assert row.predicted_stable
    assert reported[2::3] == [str(row) for row in rows]
    assert reported[:2] == ["no effect: emulation", "no effect: ngspice"]
    plain, biased = rows[0], rows[-1]
    assert biased.effect.words == "bias current 100 nA"
    assert biased.predicted_error > 10 * plain.predicted_error


@needs_ngspice
def test_an_output_current_that_is_not_refused_does_no_harm():
    network = neighbour_wired("double_integrator", 3)
    circuit, probe = SpiceBackend(level=macro()).prepare(network)
    amperes = heaviest(circuit).amperes
    enough = with_parasitics(macro(), output_current=amperes / SHARE)
    check_currents(circuit, enough)
    (row,) = effects_table(
        network, [Effect(words="enough", level=enough, made_for=macro())], patience=30.0
    )
    agree(row)
    starved = with_parasitics(macro(), output_current=0.3 * amperes)
    with pytest.raises(NetworkError, match=r"^smallest_resistor: with 1e"):
        check_currents(circuit, starved)
    backend = SpiceBackend(level=starved, require_stable=False)
    assert simulate(backend, circuit, probe, {}).control_error > 100 * row.measured_error


@needs_ngspice
@pytest.mark.parametrize("coulombs", [5e-12, 20e-12])
def test_charge_of_reset_switches_leaves_no_ripple_at_the_end(coulombs):
    """The trapezoidal rule alternates from step to step in a capacitor without a resistor."""
    level = with_parasitics(macro(), switch_charge=coulombs)
    backend = SpiceBackend(level=macro())
    circuit, probe = backend.prepare(neighbour_wired("double_integrator", 3))
    run = simulate(replace(backend, level=level), circuit, probe, {})
    first, middle, last = run.trajectory.control_values[-3:]
    ripple = np.abs(first - 2 * middle + last).max() / 4 / run.probe.control_size
    assert ripple < 1e-3 * run.control_error


@needs_ngspice
def test_both_say_that_much_capacitance_rings():
    farads = macro()
    much = Effect(
        words="much", level=with_parasitics(farads, stray_capacitance=60e-12), made_for=farads
    )
    (row,) = effects_table(neighbour_wired("double_integrator", 3), [much], patience=20.0)
    agree(row)
    assert not row.predicted_stable
    assert math.isnan(row.predicted_error)
    assert math.isnan(row.measured_settling)
    assert str(row) == "much: predicted rings; ngspice rings"


@pytest.mark.usefixtures("endless_ngspice")
def test_a_simulator_that_takes_too_long_says_nothing():
    network = neighbour_wired("double_integrator", 3)
    (row,) = effects_table(network, known_effects()[:1], patience=0.2)
    assert row.predicted_stable
    assert row.measured_stable is None
    assert str(row).endswith("ngspice nothing: terminated after 0.2 s")


def test_a_parasitic_that_does_not_exist_is_named():
    with pytest.raises(UnknownNameError, match="parasitic 'input_capacitanc'"):
        with_parasitics(macro(), input_capacitanc=1e-12)


def test_every_effect_has_parts_of_its_own():
    effects = known_effects()
    assert len({(each.level, each.made_for) for each in effects}) == len(effects)


def test_a_circuit_that_gets_lost_does_not_settle(monkeypatch):
    lost = "its transient diverged"
    monkeypatch.setattr(
        "ann_dc.fidelity.prediction.other_equilibrium_of", lambda instance, run: lost
    )
    network = neighbour_wired("double_integrator", 3)
    (row,) = effects_table(network, known_effects()[:1], simulated=False)
    assert not row.predicted_stable
    assert math.isnan(row.predicted_error)
    assert row.why == lost


def test_without_ngspice_there_are_predictions():
    network = neighbour_wired("double_integrator", 3)
    (row,) = effects_table(network, known_effects()[:1], simulated=False)
    assert row.predicted_stable
    assert row.measured_stable is None
    assert str(row).endswith("; not simulated")


def test_what_has_no_prediction_says_why():
    level = macro(output_swing=0.2)
    clamped_full_scale = Effect(words="rails", level=level, made_for=macro())
    row, *_ = effects_table(
        neighbour_wired("double_integrator", 3), [clamped_full_scale], simulated=False
    )
    assert row.predicted_stable is None
    assert row.why
    assert str(row) == "rails: predicted nothing; not simulated"


@pytest.mark.parametrize("differential", [False, True])
def test_parasitics_are_in_the_netlist_where_there_are_some_and_nowhere_else(differential):
    plain = macro(differential=differential)
    circuit, _ = SpiceBackend(level=plain).prepare(neighbour_wired("double_integrator", 3))
    op_amp = "opamp_fd" if differential else "opamp"
    bare = deck_of(circuit, plain, duration=1.0)
    assert f"models/macro/{op_amp}.lib" in bare.library
    assert not [name for name in OP_AMPS if name in bare.text]
    given = {"input_capacitance": 2e-12, "stray_capacitance": 1e-12}
    board = deck_of(circuit, with_parasitics(plain, **given), duration=1.0)
    assert f"models/board/{op_amp}.lib" in board.library
    for line in (".param opamp_cin=3e-12", ".param opamp_ib=0", ".param opamp_imax=1000"):
        assert line in board.text.splitlines()
    assert (bare.cells, bare.row) == (board.cells, board.row)
    heard = with_parasitics(plain, multiplier_noise=1e-6, amplifier_noise=1e-8)
    assert deck_of(circuit, heard, duration=1.0).text == bare.text


STANDING_IN = {
    "multiplier_nonlinearity": {"mul4q.lib", "mul4q_fd.cir"},
    "multiplier_feedthrough": {"mul4q.lib", "mul4q_fd.cir"},
    "multiplier_capacitance": {"mul4q.lib", "mul4q_fd.cir"},
    "capacitor_leakage": {"switch.lib", "integ_fd.cir", "pi_cell_fd.cir"},
    "switch_leakage": {"switch.lib", "integ_fd.cir", "pi_cell_fd.cir"},
    "switch_capacitance": {"switch.lib", "integ_fd.cir", "pi_cell_fd.cir"},
    "switch_charge": {"switch.lib", "integ_fd.cir", "pi_cell_fd.cir"},
}
"""Files of a board in a differential circuit, by the parasitic that takes them."""


@pytest.mark.parametrize("name", STANDING_IN)
def test_only_files_that_a_parasitic_concerns_are_those_of_a_board(name):
    plain = macro(differential=True)
    circuit, _ = SpiceBackend(level=plain).prepare(neighbour_wired("double_integrator", 3))
    deck = deck_of(circuit, with_parasitics(plain, **{name: 1e-3}), duration=1.0)
    board = {file.rpartition("/")[2] for file in deck.library if "/board/" in file}
    assert board == STANDING_IN[name]
    bare = deck_of(circuit, plain, duration=1.0)
    assert (bare.cells, bare.row, bare.inputs) == (deck.cells, deck.row, deck.inputs)


PLANTS = {
    "double_integrator": lambda: neighbour_wired("double_integrator", 5),
    "pendulum": lambda: neighbour_wired("pendulum", 8),
    "river": lambda: wired_by_hand("river"),
    "car": lambda: neighbour_wired("car"),
}


@pytest.mark.slow
@needs_ngspice
@pytest.mark.parametrize("plant", PLANTS)
def test_emulation_and_ngspice_agree_on_every_effect(plant):
    network = PLANTS[plant]()
    rows = effects_table(network)
    clear = [row for row in rows if not at_its_threshold(row, network)]
    assert len(rows) - len(clear) <= 2
    for row in clear:
        agree(row)


CURES = {
    "opa192_ad734": {"input_capacitance": 8e-12, "stray_capacitance": 3e-12},
    "ad8065_ad835": {"input_capacitance": 6.6e-12, "stray_capacitance": 2e-12},
}


@pytest.mark.slow
@needs_ngspice
@pytest.mark.parametrize("plant", ["car", "river"])
@pytest.mark.parametrize("name", CURES)
def test_presets_with_their_own_capacitance_settle_with_the_sizes_that_are_chosen(name, plant):
    level = with_parasitics(presets.get(name), **CURES[name])
    backend = SpiceBackend(level=level, seed=1)
    circuit, probe = backend.prepare(PLANTS[plant]())
    off = backend.deviations(circuit)
    found, run = predict(circuit, level, probe, off), simulate(backend, circuit, probe, off)
    assert found.stable
    assert run.settled()
    assert run.control_error == pytest.approx(found.control_error, rel=CLOSE)
    assert run.settling_time() == pytest.approx(found.settling_time, rel=CLOSE)
