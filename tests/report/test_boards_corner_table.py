"""Corners in words: a row for all supplies that change nothing."""

import math

from ann_dc.backends.spice.backend import SpiceBackend
from ann_dc.fidelity.boards.corners import Corner
from ann_dc.hardware.parts.conditions import Conditions
from ann_dc.hardware.parts.levels import macro
from ann_dc.report.boards import CornerTable


def corner(celsius: float, supply: float, error: float) -> Corner:
    return Corner(
        conditions=Conditions(temperature=celsius, supply=supply), control_error=error,
        settling_time=math.nan, stable=True, clipped=False, spread=1e-3, noise=1e-4,
    )  # fmt: skip


def test_supplies_that_change_nothing_share_a_row():
    places = [(27.0, 0.9, 1e-3), (27.0, 1.0, 1e-3), (27.0, 1.1, 2e-3), (85.0, 0.9, 2e-3)]
    found = CornerTable(
        corners=[corner(*place) for place in places], backend=SpiceBackend(level=macro())
    )
    (table,) = found.tables()
    rows = list(zip(*([*column.cells] for column in table.columns[:4])))
    assert rows == [
        ("27", "0.9, 1", "tt", "1.00e-03"),
        ("27", "1.1", "tt", "2.00e-03"),
        ("85", "0.9", "tt", "2.00e-03"),
    ]
    assert len(found.as_dict()["corners"]) == 4
