"""Exponents of power laws: their intervals, and what is left out."""

import math

import numpy as np
import pytest

from ann_dc.study.exponents import exponent_of


def test_the_exponent_of_a_power_law_lies_in_its_interval():
    sizes = np.array([9, 18, 36, 72, 144])
    exact = exponent_of(sizes, 3 * sizes**2.0)
    assert exact[:3] == pytest.approx((2, 2, 2), abs=1e-9)
    noise = np.random.default_rng(0)
    inside = 0
    for _ in range(400):
        found = exponent_of(sizes, 3 * sizes**1.5 * np.exp(0.1 * noise.standard_normal(5)))
        inside += found.low < 1.5 < found.high
    assert 0.92 < inside / 400 < 0.98  # 95 % by Student's t


def test_what_did_not_settle_is_left_out_of_an_exponent():
    found = exponent_of([1, 2, 4, 8], [1, 2, 4, math.nan])
    assert found.value == pytest.approx(1)
    assert math.isnan(exponent_of([1, 2, 4], [1, 2, math.nan]).value)
