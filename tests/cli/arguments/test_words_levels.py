"""What a circuit is built of: every word, and op amps for levels that have none of their own."""

from dataclasses import fields

import pytest
from command_line import QUICK, refused

from ann_dc.analysis.spectra import stability_limit
from ann_dc.cli.arguments.words import LevelOptions, level_of
from ann_dc.errors import ProblemError
from ann_dc.hardware.parts import presets
from ann_dc.hardware.parts.levels import BEHAVIOURAL, TRANSISTOR
from ann_dc.problem import plants
from ann_dc.solver import synthesize

WORDS = (
    "behavioural",
    "macro",
    "differential",
    "ota-c",
    "switched-capacitor",
    "transistor",
    "sky130",
)


@pytest.fixture(scope="module")
def network():
    return synthesize(plants.double_integrator(N=4))


@pytest.mark.parametrize("word", [*WORDS, *presets.names()])
def test_help_and_error_list_every_level(word):
    (field,) = (field for field in fields(LevelOptions) if field.name == "level")
    assert word in field.metadata["shown"].help
    refused([*QUICK, "--level", "wood"], word)


@pytest.mark.parametrize("word", ["macro", "differential", "ota-c", "switched-capacitor"])
def test_op_amps_are_chosen(word, network):
    level = level_of(LevelOptions(level=word, a0=12345.0))(network)
    assert level.datasheet.a0 == 12345


def test_ideal_parts_and_presets_are_what_they_are(network):
    assert level_of(LevelOptions(level="Behavioural"))(network) is BEHAVIOURAL
    assert level_of(LevelOptions(level="tl072_ad633"))(network).name == "tl072_ad633"


def test_switched_capacitors_step_below_the_stability_limit(network):
    level = level_of(LevelOptions(level="switched-capacitor"))(network)
    limit = stability_limit(network, network.start_state)
    assert level.technology.step == pytest.approx(0.3 * limit)


def test_transistors_are_drawn_larger(network):
    level = level_of(LevelOptions(level="transistor", area=36.0))(network)
    assert level.area == 36.0
    assert level.datasheet.multiplier_bandwidth < TRANSISTOR.datasheet.multiplier_bandwidth / 4


@pytest.mark.parametrize("word", ["macro", "sky130", "tl072_ad633"])
def test_other_parts_have_no_area(word):
    with pytest.raises(ProblemError, match="--area"):
        level_of(LevelOptions(level=word, area=36.0))
