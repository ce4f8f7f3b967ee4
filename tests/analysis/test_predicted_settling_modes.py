"""Modes of a linear flow against matrix exponentials and quadrature."""

from itertools import pairwise

import numpy as np
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from ann_dc.analysis.predicted_settling import Modes

FLOW = np.random.default_rng(0).standard_normal((7, 7)) - 3 * np.eye(7)
START = np.random.default_rng(1).standard_normal(7)


def test_deviations_are_those_of_the_matrix_exponential():
    times = np.array([0.0, 0.3, 1.7])
    found = Modes.of(FLOW).at(START, times)
    for column, time in zip(found.T, times):
        np.testing.assert_allclose(column, expm(time * FLOW) @ START, atol=1e-12)


def test_of_every_complex_pair_there_is_one():
    modes = Modes.of(FLOW)
    assert (modes.values.imag >= 0).all()
    assert len(modes.values) < 7
    assert modes.slowest == -np.linalg.eigvals(FLOW).real.max()


def test_a_push_that_is_linear_in_between_is_integrated_exactly():
    times = np.array([0.0, 1e-4, 0.2, 1.0, 2.5])
    push = np.random.default_rng(2).standard_normal((7, len(times)))
    modes = Modes.of(FLOW)
    step, pushed = modes.steps(np.diff(times)), modes.amplitudes(push)
    amplitudes = modes.amplitudes(START)

    def rhs(t, y):
        return FLOW @ y + [np.interp(t, times, p) for p in push]

    state = START
    for k, (a, b) in enumerate(pairwise(times)):
        state = solve_ivp(rhs, (a, b), state, rtol=1e-11, atol=1e-13).y[:, -1]
        amplitudes = (
            step.decay[:, k] * amplitudes
            + step.constant[:, k] * pushed[:, k]
            + step.slope[:, k] * (pushed[:, k + 1] - pushed[:, k])
        )
        np.testing.assert_allclose(modes.deviations(amplitudes), state, atol=1e-9)


def test_vectors_that_do_not_tell_modes_apart_are_seen():
    jordan = np.diag([-1.0] * 4) + np.diag([1.0] * 3, -1)
    assert Modes.of(jordan).condition > 1e10
    assert Modes.of(FLOW).condition < 1e3
