"""ngspice as a function: closed forms come out, of one deck or of many side by side."""

import numpy as np
import pytest
from ngspice_runs import (
    DISCHARGE,
    DIVIDER,
    LOWPASS,
    TAU,
)
from raw_files import ramp

from ann_dc.backends.spice.ngspice.runner import Ngspice
from ann_dc.errors import (
    SpiceCrashError,
    SpiceInputError,
)


def test_a_capacitor_discharges(ngspice):
    raw = ngspice.run(DISCHARGE, end_time=5e-6)
    np.testing.assert_allclose(raw["out"], np.exp(-raw.time / TAU), atol=1e-3)
    np.testing.assert_allclose(raw.time[-1], 5e-6, rtol=1e-9)
    assert raw.plot == "Transient Analysis"
    assert raw.title.lower() == "rc from 1 v"  # ngspice 39 gives it in lower case
    assert raw.names == ("time", "v(out)")


def test_an_operating_point(ngspice):
    raw = ngspice.run(DIVIDER.format(2.0))
    assert raw.values.shape == (1, 3)
    np.testing.assert_allclose([raw["x"][0], raw["i(v1)"][0]], [1.0, -1e-3], rtol=1e-6)


def test_several_plots(ngspice):
    deck = LOWPASS + ".op\n.ac dec 3 1k 1meg\n.tran 1u 10u\n.end\n"
    plots = {raw.plot: raw for raw in ngspice.plots(deck, end_time=1e-5)}
    assert {*plots} == {"Operating Point", "AC Analysis", "Transient Analysis"}
    response = plots["AC Analysis"]
    hertz = np.real(response["frequency"])
    assert response["out"].dtype == complex
    np.testing.assert_allclose(response["out"], 1.0 / (1.0 + 2j * np.pi * hertz * TAU), rtol=1e-6)
    np.testing.assert_allclose(hertz, np.geomspace(1e3, 1e6, 10), rtol=1e-9)
    assert (response["frequency"].imag == 0.0).all()  # ngspice leaves noise there
    with pytest.raises(SpiceInputError, match=r"3 analyses \(AC Analysis, Op.*call `plots`"):
        ngspice.run(deck)


def test_the_users_settings_do_not_matter(ngspice, tmp_path, monkeypatch):
    (tmp_path / ".spiceinit").write_text("quit 7\n")
    (tmp_path / "spinit").write_text("quit 8\n")
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("SPICE_SCRIPTS", str(tmp_path))
    monkeypatch.setenv("SPICE_ASCIIRAWFILE", "1")
    np.testing.assert_allclose(ngspice.run(DIVIDER.format(1.0))["x"], 0.5)


def test_runs_are_equal_to_the_bit(ngspice):
    deck = LOWPASS + ".ac dec 3 1k 1meg\n.end\n"
    np.testing.assert_array_equal(ngspice.run(deck).values, ngspice.run(deck).values)


def test_what_is_no_deck(stand_in):
    ngspice = stand_in("")
    with pytest.raises(SpiceInputError, match=r"not text: .*surrogates"):
        ngspice.run("\ud800")
    with pytest.raises(SpiceInputError, match="got one text; call `run`"):
        ngspice.run_many("deck")


@pytest.mark.parametrize("wrong", [{"timeout": 0.0}, {"timeout": np.nan}, {"workers": 0}])
def test_settings_are_checked(wrong):
    (name,) = wrong
    with pytest.raises(SpiceInputError, match=f"{name}: expected"):
        Ngspice(**wrong)
    assert issubclass(SpiceInputError, ValueError)


def test_many_decks_in_order(ngspice, tmp_path):
    meaning = []
    decks = [DIVIDER.format(v) for v in range(2, 22)]
    decks[3] = "wrong\nX1 a b nosuch\n.op\n.end\n"
    results = Ngspice(keep=tmp_path, workers=3, progress=meaning.append).run_many(iter(decks))
    failed = results.pop(3)
    assert isinstance(failed, SpiceCrashError)
    np.testing.assert_allclose(
        [raw["x"][0] for raw in results], [1, 1.5, 2, *np.arange(3, 11, 0.5)]
    )
    assert meaning[2] == "3 of 20 decks"
    assert len(meaning) == 20


def test_slow_decks_first(stand_in):
    ngspice = stand_in("sleep 0.$(cat deck.cir); cp $here/$(cat deck.cir).raw out.raw", **{
        str(i): ramp(float(i)) for i in range(1, 6)
    })  # fmt: skip
    ends = [raw.time[-1] for raw in ngspice.run_many(["5", "4", "3", "2", "1"])]
    assert ends == [5.0, 4.0, 3.0, 2.0, 1.0]
