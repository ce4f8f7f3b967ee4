"""Specs are read, never evaluated; what cannot be read is told."""

import numpy as np
import pytest

from ann_dc.errors import ArgumentError, NetworkError
from ann_dc.fidelity.boards.yields import Spec, spec_of


@pytest.mark.parametrize(
    ("text", "limits"),
    [
        ("error<1%", {"error": 0.01}),
        (" Error <= 2e-3 ", {"error": 2e-3}),
        ("settle<50us,error<.5%", {"error": 5e-3, "settling_time": 5e-5}),
        ("settle<0.1ms", {"settling_time": 1e-4}),
        ("stable", {}),
        ("stable, settle<3e2ns", {"settling_time": 3e-7}),
    ],
)
def test_a_spec_says_what_it_limits(text, limits):
    spec = spec_of(text)
    assert spec.limits == pytest.approx(limits)
    assert spec_of(str(spec)).limits == pytest.approx(spec.limits)


@pytest.mark.parametrize(
    "text",
    ["", "error", "error>1%", "error<1%,", "error<1us", "settle<5%", "error<0",
     "error<-1%", "error<1.2.3", "error<nan", "error<1%, error<2%", "error<1e999",
     "__import__('os')<1", "error<1%; settle<1us"],
)  # fmt: skip
def test_what_is_no_spec_is_refused(text):
    with pytest.raises(NetworkError, match="spec: expected terms"):
        spec_of(text)


@pytest.mark.parametrize(
    ("text", "reported"),
    [
        ("settle<50", "'settle<50' needs ns, us, ms or s"),
        ("error<1", "'error<1' is 100 % of the largest control; write error<1% for"),
    ],
)
def test_a_unit_that_was_forgotten_is_asked_for(text, reported):
    with pytest.raises(NetworkError, match=reported):
        spec_of(text)


def test_micro_has_three_letters():
    assert spec_of("settle<5µs") == spec_of("settle<5us") == spec_of("settle<5μs")


def test_limits_are_positive():
    with pytest.raises(ArgumentError, match="error"):
        Spec(error=-1.0)


def test_the_worse_figure_counts_and_an_unknown_one_is_none():
    spec = Spec(error=0.01, settling_time=1e-5)
    assert spec.excess(0.005, 2e-5) == pytest.approx(2.0)
    assert spec.excess(0.02, 1e-5) == pytest.approx(2.0)
    assert spec.excess(0.001, np.nan) == np.inf
    assert Spec().excess(0.5, np.nan) == 0.0
