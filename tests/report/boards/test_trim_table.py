"""Trims in words: circuits that do not settle are told, and no pass."""

import numpy as np
import pytest
from rich.console import Console

from ann_dc.backends.spice import SpiceBackend
from ann_dc.fidelity.boards import Trimming
from ann_dc.hardware.parts import macro
from ann_dc.report.boards import TrimTable


def shown(after):
    errors = np.array(after)
    found = Trimming(
        error=0.05, share=0.95, untrimmed=0.03, floor=0.03, steps=(), before=errors, after=errors
    )
    table = TrimTable(found=found, backend=SpiceBackend(level=macro()))
    console = Console(width=200)
    with console.capture() as said:
        console.print(*table.tables())
    return table, said.get()


@pytest.mark.filterwarnings("error")
def test_circuits_that_do_not_settle_are_infinitely_wrong():
    table, words = shown([np.inf] * 9 + [0.01])
    assert not table.good
    assert "unsettled before, unsettled after" in words
    assert "1 of 10" in words
    assert "9 do not settle" in words
    assert table.as_dict()["trimming"]["confirmed"] is False


def test_circuits_that_keep_it_confirm_it():
    table, words = shown([0.01] * 20)
    assert table.good
    assert "1.00% before, 1.00% after, of 20 drawn circuits" in words
    assert "20 of 20" in words
    assert "do not settle" not in words
