"""Forms of the stage equations: switches and what they keep."""

from dataclasses import replace

import pytest

from ann_dc.decomposition.form import (
    CORRECTED,
    PRINTED,
    PRINTED_CONDITIONS,
    PRINTED_EXAMPLE,
    SWITCHES,
    switch,
)
from ann_dc.errors import UnknownNameError


@pytest.mark.parametrize("name", SWITCHES)
def test_a_switch_says_its_name(name):
    value = {"S7": " (0.99)", "S12": " (1/N)"}.get(name, "")
    assert str(switch(name)) == f"with {name}{value}"


def test_names_of_whole_forms():
    assert str(CORRECTED) == "corrected"
    assert str(PRINTED) == "with S1, S3, S4, S5, S6, S8, S9, S11, S12 (1/N)"
    assert str(PRINTED_CONDITIONS) == "with S3, S4, S5, S6, S8, S10, S12 (1/N)"
    assert str(PRINTED_EXAMPLE) == "with S7 (0.99), S12 (N)"
    assert str(replace(PRINTED_EXAMPLE, coupling_coefficient=0.55)) == "with S7 (0.55), S12 (N)"


def test_an_unknown_switch_is_answered_with_those_that_exist():
    with pytest.raises(UnknownNameError, match=r"switch 'S18' does not exist; .*S1, .*S17"):
        switch("S18")


def test_gains_are_designed_for_the_corrected_form_with_the_same_closing():
    assert PRINTED.designable == CORRECTED
    assert replace(PRINTED, start_is_neuron=True).designable == SWITCHES["S14"]
    assert replace(SWITCHES["S14"], oracle_gain=True).designable == SWITCHES["S14"]
    assert SWITCHES["S13"].designable == SWITCHES["S13"]
