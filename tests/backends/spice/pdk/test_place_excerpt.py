"""An excerpt holds the models of the geometries in use, and the parameters that these name."""

import pytest
from small_pdk import fet, put, transistor, written

from ann_dc.backends.spice.pdk.devices import Device
from ann_dc.backends.spice.pdk.place import excerpt
from ann_dc.errors import FileFormatError, NetworkError
from ann_dc.hardware.parts.conditions import CORNERS, Conditions

TRANSISTOR = Device(name="nfet_g5v0d10v5", width=20.0, length=1.0)


def models_of(cards):
    return [card.split()[1].rpartition(".")[2] for card in cards if card.startswith(".model")]


@pytest.mark.parametrize(("width", "model"), [(1.0, "0"), (19.9, "0"), (20.0, "1"), (99.0, "1")])
def test_one_model_a_geometry(tmp_path, width, model):
    device = Device(name="nfet_g5v0d10v5", width=width, length=1.5)
    assert models_of(excerpt([device], written(tmp_path))) == [model]


def test_two_geometries_share_a_subcircuit(tmp_path):
    both = [TRANSISTOR, Device(name="nfet_g5v0d10v5", width=5.0)]
    cards = excerpt(both, written(tmp_path))
    assert models_of(cards) == ["0", "1"]
    assert sum(card.startswith(".subckt") for card in cards) == 1


def test_parameters_are_those_that_are_named_and_those_that_these_name(tmp_path):
    text = "\n".join(excerpt([TRANSISTOR], written(tmp_path)))
    assert ".param nfet__ku0_diff=twice" in text
    assert ".param twice=2.0" in text
    assert ".param nfet__slope=0.5" in text
    assert "unused" not in text
    assert "area_tt" not in text


def test_a_corner_has_models_of_its_own(tmp_path):
    files = written(tmp_path)
    slow = excerpt([TRANSISTOR], files, conditions=Conditions(process="ss"))
    assert "{0.8+MC_MM_SWITCH" in "\n".join(slow)
    assert "{0.7+MC_MM_SWITCH" in "\n".join(excerpt([TRANSISTOR], files))


@pytest.mark.parametrize("mismatch", [False, True])
def test_mismatch_is_a_switch(tmp_path, mismatch):
    cards = excerpt([TRANSISTOR], written(tmp_path), mismatch=mismatch)
    assert f".param mc_mm_switch={int(mismatch)} mc_pr_switch=0" in cards


def test_the_licence_stands_above(tmp_path):
    assert "Apache License 2.0" in excerpt([TRANSISTOR], written(tmp_path))[0]


@pytest.mark.parametrize("size", [(100.0, 1.0), (20.0, 0.5), (20.0, 2.0)])
def test_a_size_without_a_model_is_refused(tmp_path, size):
    device = Device(name="nfet_g5v0d10v5", width=size[0], length=size[1])
    with pytest.raises(NetworkError, match="no model of width"):
        excerpt([device], written(tmp_path))


@pytest.mark.parametrize("temperature", [-41.0, 126.0])
def test_a_temperature_that_models_are_not_made_for_is_refused(tmp_path, temperature):
    at = Conditions(temperature=temperature)
    with pytest.raises(NetworkError, match=r"temperature: models of sky130 .* -40 to 125 C"):
        excerpt([TRANSISTOR], written(tmp_path), conditions=at)


@pytest.mark.parametrize("supply", [0.89, 1.11])
def test_supplies_that_devices_are_not_made_for_are_refused(tmp_path, supply):
    with pytest.raises(NetworkError, match=r"supply: circuits of sky130 .* 0.9 to 1.1 times"):
        excerpt([TRANSISTOR], written(tmp_path), conditions=Conditions(supply=supply))


def test_a_corner_that_does_not_exist_is_refused():
    with pytest.raises(NetworkError, match=", ".join(CORNERS)):
        Conditions(process="tx")


@pytest.mark.parametrize("given", ["least", "lmin = 1.2.3 x", "lmin = - x", "lmin = 1.0u x"])
def test_a_model_without_a_range_of_sizes_is_refused(tmp_path, given):
    files = written(tmp_path)
    put(files, fet("tt.pm3"), transistor(0.7).replace("lmin", given))
    with pytest.raises(FileFormatError, match="a model without range"):
        excerpt([TRANSISTOR], files)
