"""Objectives: of eigenvalues that are given."""

import numpy as np
import pytest

from ann_dc.analysis.objectives import SETTLING_TIME, STEPS

MODES = np.array([-4.0, -0.5 + 1j, -0.5 - 1j, -2.0])


@pytest.mark.parametrize("c", [1e-6, 1e6])
@pytest.mark.parametrize("sharpness", [8.0, 200.0])
def test_settling_in_time_constants_has_no_unit_of_time(c, sharpness):
    plain = SETTLING_TIME.smoothed(MODES, 1.0, sharpness, 1e-3)
    scaled = SETTLING_TIME.smoothed(c * MODES, 1.0, sharpness, 1e-3)
    assert scaled.value == pytest.approx(plain.value, rel=1e-12)
    np.testing.assert_allclose(c * scaled.by_eigenvalue, plain.by_eigenvalue, atol=1e-12)


def test_the_smoothed_time_comes_down_to_the_slowest_mode():
    values = [SETTLING_TIME.smoothed(MODES, 1.0, p, 1e-3).value for p in (2, 8, 200, 2000)]
    assert values == sorted(values, reverse=True)
    assert SETTLING_TIME.slowness(MODES, 1.0) == 8.0
    assert values[-1] == pytest.approx(np.log(8.0), rel=1e-3)


def test_steps_of_one_mode():
    modes = np.array([-2.0 + 0j])
    assert STEPS.slowness(modes, 0.25) == pytest.approx(1 / np.log(2))
    assert STEPS.slowness(modes, 1.25) == np.inf
