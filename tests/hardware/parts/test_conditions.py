"""Circuits at other temperatures, supplies and process corners."""

from functools import cache

import numpy as np
import pytest
from simulator import needs_ngspice

from ann_dc import PreconditionerKind, design, plants
from ann_dc.backends.spice.backend import SpiceBackend
from ann_dc.backends.spice.circuit_run import CircuitRun
from ann_dc.errors import NetworkError
from ann_dc.hardware.parts.conditions import NOMINAL, Conditions
from ann_dc.hardware.parts.levels import TRANSISTOR, macro

HARDEST = (
    Conditions(temperature=-40.0, supply=0.9, process="ss"),
    Conditions(temperature=125.0, supply=1.1, process="ff"),
    Conditions(temperature=-40.0, supply=1.1, process="sf"),
    Conditions(temperature=125.0, supply=0.9, process="fs"),
)


@cache
def rail(conditions: Conditions) -> CircuitRun:
    network = design(
        plants.double_integrator(N=3), preconditioner=PreconditionerKind.DIAGONAL
    ).network
    return SpiceBackend(level=TRANSISTOR.at(conditions)).run(network)


@pytest.mark.sampled(2)
@needs_ngspice
@pytest.mark.parametrize("conditions", HARDEST, ids=str)
def test_a_circuit_of_op_amps_settles_at_every_corner(conditions):
    run = rail(conditions)
    assert run.settled()
    assert run.control_error < 5e-3


@needs_ngspice
def test_heat_lowers_the_gain_and_a_constant_transconductance_keeps_the_speed():
    room, hot = rail(NOMINAL), rail(Conditions(temperature=125.0))
    assert hot.control_error > 1.2 * room.control_error
    assert hot.settling_time() == pytest.approx(room.settling_time(), rel=0.05)


@needs_ngspice
@pytest.mark.slow
@pytest.mark.parametrize("conditions", HARDEST, ids=str)
def test_the_car_keeps_its_controls_over_temperature_supply_and_process(conditions):
    network = design(plants.car(N=3), preconditioner=PreconditionerKind.DIAGONAL).network
    run = SpiceBackend(level=TRANSISTOR.at(conditions)).run(network)
    assert run.settled()
    assert run.control_error < 2e-2


def deck(level, conditions: Conditions = NOMINAL) -> str:
    network = design(
        plants.double_integrator(N=3), preconditioner=PreconditionerKind.DIAGONAL
    ).network
    backend = SpiceBackend(level=level.at(conditions))
    return backend.deck(*backend.prepare(network), deviations={}).text


@pytest.mark.parametrize("level", [TRANSISTOR, macro()], ids=lambda level: level.name)
def test_temperature_is_a_card_behind_the_models(level):
    nominal, hot = deck(level).splitlines(), deck(level, Conditions(temperature=85.0)).splitlines()
    assert hot.index(".temp 85") > max(n for n, line in enumerate(hot) if line[:4] == ".mod")
    assert [line for line in hot if line != ".temp 85"] == nominal


def test_transistors_read_their_supplies_and_corner():
    text = deck(TRANSISTOR, Conditions(supply=0.9, process="sf"))
    for parameter in ("supply=0.9", "slow_n=1", "slow_p=-1"):
        assert f"\n.param {parameter}\n" in text


def test_rails_of_macro_models_are_those_of_their_supplies():
    text = deck(macro(output_swing=10.0), Conditions(supply=0.9))
    assert ".param opamp_vsat=9\n" in text
    assert ".param opamp_vsat=10\n" not in text


def test_power_is_that_of_the_supplies():
    room = TRANSISTOR.datasheet
    low = TRANSISTOR.at(Conditions(supply=0.9)).datasheet
    assert low.amplifier_power == pytest.approx(0.9 * room.amplifier_power)
    assert low.multiplier_power == pytest.approx(0.9 * room.multiplier_power)


def test_conditions_of_no_model_are_refused():
    for wrong in ({"temperature": 300.0}, {"supply": 0.0}, {"process": "xx"}, {"supply": np.inf}):
        with pytest.raises(NetworkError):
            Conditions(**wrong)
