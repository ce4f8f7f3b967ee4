"""Circuits of a foundry's transistors: what their cells measure, and a network that settles."""

from dataclasses import replace

import numpy as np
import pytest
from constrained import integrator, v
from simulator import needs_ngspice
from small_pdk import needs_pdk

from ann_dc.backends.spice.backend import SpiceBackend
from ann_dc.backends.spice.ngspice.runner import Ngspice
from ann_dc.backends.spice.pdk.place import INSTEAD, place_of
from ann_dc.gain_design.procedure import design
from ann_dc.hardware.parts.conditions import NOMINAL, Conditions
from ann_dc.hardware.parts.foundry import SKY130
from ann_dc.network.preconditioners.base import PreconditionerKind
from ann_dc.problem import plants
from ann_dc.resources import circuits_path
from ann_dc.solver import synthesize

MODELS = circuits_path() / "models" / "sky130"


def library(*names: str) -> dict[str, str]:
    return {name: (MODELS / f"{name}.lib").read_text(encoding="utf-8") for name in names}


def measured(cards: str, analysis: str, *names: str, at: Conditions = NOMINAL, seed=None):
    """Voltages of a testbench."""
    used = library(*names)
    place = place_of(SKY130.at(at), used | {"bench": cards}, seed)
    options = f".options {place.options}"
    text = ["* testbench", *place.before, *used.values(), cards, options, analysis]
    return Ngspice().run("\n".join([*text, ".end", ""]))


@needs_pdk
@needs_ngspice
@pytest.mark.parametrize("load", [20e3, 45e3, 1e9])
def test_the_op_amp_has_the_gain_and_the_bandwidth_of_its_level(load):
    cards = f"""V1 in 0 DC 0 AC 1
X1 in fb out opamp
L1 out fb 1meg
C1 fb 0 1meg
R1 out 0 {load}
C2 out 0 2p"""
    raw = measured(cards, ".ac dec 1 1 1meg", "opamp")
    gain, sheet = np.abs(raw["out"]), SKY130.datasheet
    assert gain[0] == pytest.approx(sheet.a0 / (1 + sheet.stage_resistance / load), rel=0.03)
    assert gain[-1] * 1e6 == pytest.approx(sheet.gbw, rel=0.04)


@needs_pdk
@needs_ngspice
@pytest.mark.parametrize("at", [NOMINAL, Conditions(temperature=125.0)])
def test_the_multiplier_multiplies_at_any_temperature(at):
    pairs = [(-0.8, 0.8), (0.5, 0.5), (0.8, -0.8), (0.8, 0.0)]
    cards = "\n".join(
        f"Vx{i} x{i} 0 {x}\nVy{i} y{i} 0 {y}\nX{i} x{i} 0 y{i} 0 0 o{i} mul4q"
        for i, (x, y) in enumerate(pairs)
    )
    cards += "\nVz z 0 0.8\nXz 0 0 0 0 z oz mul4q"
    raw = measured(cards, ".op", "opamp", "mul4q", at=at)
    for i, (x, y) in enumerate(pairs):
        assert float(raw[f"o{i}"][-1]) == pytest.approx(x * y, abs=1.2e-3)
    assert float(raw["oz"][-1]) == pytest.approx(0.8, abs=1.2e-3)


@needs_pdk
@needs_ngspice
@pytest.mark.parametrize("seed", [None, 1])
def test_a_diode_neuron_is_rectified(seed):
    """In reset, where m is rf times the current into it, and the switch adds its own resistance."""
    amperes = (-8e-6, -1e-6, 1e-6, 5e-6)
    cards = "\n".join(
        f"I{i} 0 s{i} {i_s}\nX{i} s{i} o{i} rst pi_diode rf=100k rp=10k"
        for i, i_s in enumerate(amperes)
    )
    raw = measured(f"Vrst rst 0 5\n{cards}", ".op", "opamp", "switch", "pi_diode", seed=seed)
    allowed = 1e-3 if seed is None else 20e-3
    for i, i_s in enumerate(amperes):
        assert float(raw[f"o{i}"][-1]) == pytest.approx(
            -max(100e3 * i_s, 0.0), rel=0.03, abs=allowed
        )


@needs_pdk
@needs_ngspice
def test_a_network_settles_in_a_circuit_of_the_foundrys_transistors():
    network = design(
        synthesize(plants.double_integrator(N=2)), preconditioner=(PreconditionerKind.DIAGONAL,)
    ).network
    run = SpiceBackend(level=SKY130).run(network)
    assert run.settled()
    assert 1e-5 < run.control_error < 3e-3
    assert not run.overloads


@pytest.mark.slow
@needs_pdk
@needs_ngspice
def test_a_network_with_diode_neurons_settles_without_any_ideal_switch():
    """With a limit on its speed that several stages keep: a quarter of a minute."""
    problem = integrator(N=8, dt=0.25, bounds={v: (None, 0.65)})
    network = design(synthesize(problem), preconditioner=(PreconditionerKind.DIAGONAL,)).network
    backend = SpiceBackend(level=SKY130)
    circuit, probe = backend.prepare(network)
    deck = backend.deck(circuit, probe, {})
    assert "pi_diode" in deck.text
    assert "reset_sw" not in deck.text
    run = backend.measure(circuit, deck, probe)
    assert run.settled()
    assert run.control_error < 5e-3


@needs_pdk
def test_conditions_and_mismatch_reach_the_deck():
    network = design(
        synthesize(plants.double_integrator(N=2)), preconditioner=(PreconditionerKind.DIAGONAL,)
    ).network
    backend = SpiceBackend(level=SKY130)
    circuit, probe = backend.prepare(network)

    def deck(**given):
        other = replace(backend, **given)
        return other.deck(circuit, probe, other.deviations(circuit))

    plain = deck()
    assert "scale=1u temp=27 " in plain.options
    assert ".param mc_mm_switch=0" in plain.text
    assert ".param supply=1\n" in plain.text
    assert "mul4q" not in plain.text, "its bias would be there for nothing"
    hot = deck(level=SKY130.at(Conditions(temperature=85.0, supply=0.9, process="ss")))
    assert "temp=85" in hot.options
    assert ".param supply=0.9\n" in hot.text
    drawn = deck(seed=3)
    assert "seed=4" in drawn.options
    assert ".param mc_mm_switch=1" in drawn.text
    assert drawn.text == deck(seed=3).text
    assert drawn.text != deck(seed=4).text


def test_what_the_level_has_instead_is_there():
    for name in INSTEAD.values():
        assert (circuits_path() / name).is_file()
