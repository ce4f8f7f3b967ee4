"""Trims in words: circuits that do not settle are told, and no pass."""

import numpy as np
import pytest
from rich.console import Console

from ann_dc.backends.spice.backend import SpiceBackend
from ann_dc.fidelity.boards.trimming import Trimming
from ann_dc.hardware.parts.levels import macro
from ann_dc.report.boards import TrimTable


def shown(after, **given):
    errors = np.array(after)
    found = Trimming(
        error=0.05,
        share=0.95,
        untrimmed=0.03,
        floor=0.03,
        steps=(),
        places=7,
        noise=np.nan,
        before=errors,
        after=errors,
    )
    table = TrimTable(found=found, backend=SpiceBackend(level=macro(), **given))
    console = Console(width=200)
    with console.capture() as said:
        console.print(*table.tables())
    return table, " ".join(said.get().replace("│", " ").split())


@pytest.mark.filterwarnings("error")
def test_circuits_that_do_not_settle_are_infinitely_wrong():
    table, words = shown([np.inf] * 9 + [0.01])
    assert not table.good
    assert "to not settled, from not settled" in words
    assert "1 of 10" in words
    assert "9 do not settle" in words
    assert "use better resistors or parts" in words
    assert table.as_dict()["trimming"]["reached"] is False


def test_as_many_as_were_asked_for_keep_it():
    table, words = shown([0.01] * 20)
    assert table.good
    assert "0 trims bring 95% of 20 emulated circuits to 1.00%, from 1.00%" in words
    assert "20 of 20" in words
    assert "do not settle" not in words
    assert "3.00% with all 7" in words
    undecided, words = shown([0.01] * 91 + [0.06] * 9)
    assert not undecided.good
    assert "undecided: " in words
    assert "draw more (--samples)" in words
    worse, words = shown([0.01] * 50 + [0.06] * 50)
    assert not worse.good
    assert "use better resistors or parts" in words


def test_a_coarse_series_of_resistors_is_to_be_replaced_by_pairs():
    _, words = shown([0.06] * 20, series="E96")
    assert "E96 rounds by up to 1.5%; use --series E96-pairs" in words
    _, words = shown([0.06] * 20, series="E96-pairs")
    assert "use better resistors or parts" in words
