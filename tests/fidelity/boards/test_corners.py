"""Corners: a circuit over temperature, supplies and process."""

import math
import sys
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from simulator import needs_ngspice

from ann_dc import PreconditionerKind, SpiceBackend, design, plants
from ann_dc.errors import NetworkError
from ann_dc.fidelity.boards.corners import corners
from ann_dc.fidelity.prediction import predict
from ann_dc.hardware.parts import presets
from ann_dc.hardware.parts.conditions import Conditions
from ann_dc.hardware.parts.datasheet import Datasheet, Tolerances
from ann_dc.hardware.parts.levels import TRANSISTOR, macro

PARTS = Tolerances(resistor=1e-3, resistor_drift=1e-5, offset=1e-5, offset_drift=1e-7)


@pytest.fixture(scope="module")
def network():
    return design(plants.double_integrator(N=3), preconditioner=PreconditionerKind.DIAGONAL).network


def test_every_place_has_the_figures_of_the_level_there(network):
    backend = SpiceBackend(level=macro(a0=1e4, output_swing=14.0, tolerances=PARTS), seed=1)
    circuit, probe = backend.prepare(network)
    found = corners(backend, circuit, probe, temperatures=[-40.0, 125.0], supplies=[0.9, 1.1])
    assert len(found) == 4
    for corner in found:
        level = backend.level.at(corner.conditions)
        off = SpiceBackend(level=level, seed=1).deviations(circuit)
        wanted = predict(circuit, level, probe, off)
        assert corner.control_error == pytest.approx(wanted.control_error, rel=1e-9)
        assert corner.settling_time == pytest.approx(wanted.settling_time, rel=1e-9)
        assert corner.within_tolerance


def test_a_place_that_changes_nothing_is_not_emulated_again(network, monkeypatch):
    known = sys.modules["ann_dc.fidelity.boards.corners"]
    asked, emulate = [], known.prediction_of
    monkeypatch.setattr(known, "prediction_of", lambda s: asked.append(s) or emulate(s))
    power = Datasheet(a0=1e6, amplifier_power=1e-3, multiplier_power=1e-2)
    for level, times in ((macro(), 1), (macro(power), 1), (macro(output_swing=14.0), 3)):
        asked.clear()
        backend = SpiceBackend(level=level)
        assert len(corners(backend, *backend.prepare(network))) == 9
        assert len(asked) == times


def test_tolerances_spread_more_where_parts_drift(network):
    backend = SpiceBackend(level=macro(tolerances=PARTS))
    found = corners(backend, *backend.prepare(network), supplies=[1.0])
    cold, room, hot = (corner.spread for corner in found)
    assert hot > cold > room


def test_noise_grows_with_heat_and_counts(network):
    backend = SpiceBackend(level=macro())
    cold, hot = corners(backend, *backend.prepare(network), temperatures=[0.0, 100.0], supplies=[1])
    assert hot.noise / cold.noise == pytest.approx(math.sqrt(373.15 / 273.15), rel=1e-6)
    assert hot.control_error == cold.control_error
    assert hot.within_tolerance
    assert not replace(hot, noise=1e-2).within_tolerance
    assert replace(hot, noise=math.nan).within_tolerance


def test_rails_below_what_a_circuit_needs_clip_it(network):
    backend = SpiceBackend(level=macro(output_swing=1.12))
    circuit, probe = backend.prepare(network)
    low, full = corners(backend, circuit, probe, temperatures=[27.0], supplies=[0.5, 1.0])
    assert not low.within_tolerance
    assert low.clipped
    assert np.isnan(low.control_error)
    assert "clip at 0.56 V with supplies of 0.5 times the nominal voltage" in low.remark
    assert full.within_tolerance


@needs_ngspice
def test_supplies_that_leave_a_board_no_room_are_no_corner_that_works(network):
    """Parts bend before they clip: ngspice's controls are off by percents there."""
    backend = SpiceBackend(level=presets.get("opa192_ad734"))
    circuit, probe = backend.prepare(network)
    (corner,) = corners(backend, circuit, probe, temperatures=[27.0], supplies=[0.6])
    assert corner.clipped
    low = replace(backend, level=backend.level.at(Conditions(supply=0.6)))
    run = low.measure(circuit, low.deck(circuit, probe, {}), probe)
    assert run.overloads
    assert run.control_error > 1e-2


def test_what_is_not_known_of_a_corner_is_told(network, monkeypatch):
    monkeypatch.setattr("ann_dc.fidelity.prediction.LARGEST", 10)
    backend = SpiceBackend(level=macro())
    place = {"temperatures": [27.0], "supplies": [1.0]}
    (corner,) = corners(backend, *backend.prepare(network), **place)
    assert np.isnan(corner.settling_time)
    assert "more than 10" in corner.remark


@pytest.mark.parametrize("why", ["the run is too short to decide", "the controls still change"])
def test_a_corner_whose_run_does_not_tell_is_none(network, monkeypatch, why):
    run = SimpleNamespace(unsettled=why, settled=lambda: True, overloads=(), control_error=1e-4)
    module = sys.modules[corners.__module__]
    monkeypatch.setattr(module, "measured_runs", lambda *given: [run])
    backend = SpiceBackend()
    place = {"temperatures": [27.0], "supplies": [1.0]}
    (corner,) = corners(backend, *backend.prepare(network), **place)
    assert not corner.within_tolerance
    assert np.isnan(corner.control_error)
    assert corner.remark == why


@needs_ngspice
def test_transistors_run_in_ngspice_and_heat_costs_gain(network):
    backend = SpiceBackend(level=TRANSISTOR)
    circuit, probe = backend.prepare(network)
    cold, hot = corners(
        backend, circuit, probe, temperatures=[-40.0, 125.0], supplies=[1.0], processes=["ss"]
    )
    alone = SpiceBackend(level=TRANSISTOR.at(Conditions(temperature=125.0, process="ss")))
    assert hot.control_error == pytest.approx(alone.run(network).control_error, rel=1e-6)
    assert cold.control_error < hot.control_error
    assert not hot.clipped


@pytest.mark.parametrize(
    ("given", "named"),
    [
        ({"temperatures": [300.0]}, "temperature"),
        ({"supplies": [0.0]}, "supply"),
        ({"processes": ["xx"]}, "process: expected one of"),
        ({"processes": ["ss"]}, "process: macro parts have no transistors"),
    ],
)
def test_places_that_do_not_exist_are_named(network, given, named):
    backend = SpiceBackend(level=macro())
    circuit, probe = backend.prepare(network)
    with pytest.raises(NetworkError, match=named):
        corners(backend, circuit, probe, **given)
