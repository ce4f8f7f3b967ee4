"""The suite, row by row: a fast part for CI, the rest marked slow (`make suite` is the table)."""

import pytest
from bench.suite import measure
from problems import SUITE

FAST = ("car_g2", "double_integrator")


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    "name", [name if name in FAST else pytest.param(name, marks=pytest.mark.slow) for name in SUITE]
)
def test_every_start_settles_to_a_certified_optimum(name):
    row = measure(name)
    assert row.certified == row.known + row.own >= 5, row.remark
    assert row.frozen, row.remark
    assert 0.5 < row.settling / row.predicted < 1.5
