"""Yield in words: a settling time that is not known is told."""

import numpy as np
import pytest
from rich.console import Console

from ann_dc.backends.spice.backend import SpiceBackend
from ann_dc.fidelity.boards.yields import CircuitYield, Spec, Spot
from ann_dc.hardware.parts.levels import macro
from ann_dc.report.boards import YieldTable
from ann_dc.study.yield_metrics import Yield


def test_circuits_whose_settling_time_is_not_known_are_counted():
    found = CircuitYield(
        spec=Spec(settling_time=1e-5), seeds=(0, 1), errors=np.array([1e-3, 2e-3]), noise=np.nan,
        settling_times=np.full(2, np.nan), unknown=("its transient ran out of steps",) * 2,
        found=Yield(passed=0, count=2), spots=(),
    )  # fmt: skip
    table = YieldTable(yielded=found, backend=SpiceBackend(level=macro()))
    console = Console(width=200)
    with console.capture() as said:
        console.print(*table.tables())
    assert (
        "unknown for 2 circuits, which count as failed: its transient ran out of steps"
        in said.get()
    )
    assert "resistors 1 %, offsets of op amps 1 mV" in said.get()
    assert "not computed, not included" in said.get()
    assert table.as_dict()["yield"]["unknown"] == found.unknown


@pytest.mark.parametrize(("spec", "columns"), [(Spec(error=0.01), 5), (Spec(settling_time=1), 7)])
def test_times_of_spots_are_told_where_the_spec_has_one(spec, columns):
    spot = Spot(
        seed=0, predicted=1e-3, measured=1.1e-3, predicted_time=2e-5, measured_time=2.1e-5,
        kept=(True, True), agreed=True,
    )  # fmt: skip
    found = CircuitYield(
        spec=spec, seeds=(0,), errors=np.array([1e-3]), noise=2e-4, settling_times=np.array([2e-5]),
        unknown=("",), found=Yield(passed=1, count=1), spots=(spot,),
    )  # fmt: skip
    table = YieldTable(yielded=found, backend=SpiceBackend(level=macro())).tables()[-1]
    assert len(table.columns) == columns
    assert ("20 us" in [*table.columns[-4].cells]) == (columns == 7)
