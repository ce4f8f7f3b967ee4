"""Yield in words: a settling time that is not known is told."""

import numpy as np
from rich.console import Console

from ann_dc.backends.spice import SpiceBackend
from ann_dc.fidelity.boards import CircuitYield, Spec
from ann_dc.hardware.parts import macro
from ann_dc.report.boards import YieldTable
from ann_dc.study.measuring import Yield


def test_circuits_whose_settling_time_is_not_known_are_counted():
    found = CircuitYield(
        spec=Spec(settling_time=1e-5), seeds=(0, 1), errors=np.array([1e-3, 2e-3]),
        settling_times=np.full(2, np.nan), unknown=("its transient ran out of steps",) * 2,
        found=Yield(passed=0, count=2), spots=(),
    )  # fmt: skip
    table = YieldTable(yielded=found, backend=SpiceBackend(level=macro()))
    console = Console(width=200)
    with console.capture() as said:
        console.print(*table.tables())
    assert "not known of 2, which count as lost: its transient ran out of steps" in said.get()
    assert "resistors 1 %, offsets of op amps 1 mV" in said.get()
    assert table.as_dict()["yield"]["unknown"] == list(found.unknown)
