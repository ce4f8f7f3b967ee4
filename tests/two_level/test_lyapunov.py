"""Theta, A and B: a step of the coordination variables changes Theta by A lambda^2 + B lambda."""

import numpy as np
from hypothesis import given, strategies as st
from hypothesis.extra.numpy import arrays

from ann_dc.two_level.lyapunov import Lyapunov, lyapunov_of, printed_of

NUMBERS = st.floats(-10, 10, allow_subnormal=False)
PAIRS = st.tuples(st.integers(1, 6), st.integers(1, 3)).flatmap(
    lambda shape: st.tuples(*(arrays(float, shape, elements=NUMBERS) for _ in range(2)))
)


@given(pair=PAIRS, gain=st.floats(-5, 5))
def test_theta_along_a_step_is_a_parabola(pair, gain):
    e, d = pair
    here, there = lyapunov_of(e, d), lyapunov_of(e + gain * d, d)
    expected = here.theta + here.A * gain**2 + here.B * gain
    np.testing.assert_allclose(there.theta, expected, atol=1e-9)
    assert here.theta.shape == e.shape[1:]  # one Theta a sample


@given(PAIRS.filter(lambda pair: (abs(pair[1]).max(axis=0) > 1e-2).all()), st.floats(0.01, 0.99))
def test_theta_falls_inside_the_bound_and_is_back_at_it(pair, share):
    e, d = pair
    found = lyapunov_of(e, d)
    at_bound = lyapunov_of(e + found.bound * d, d)
    inside = lyapunov_of(e + share * found.bound * d, d)
    np.testing.assert_allclose(at_bound.theta, found.theta, rtol=1e-9, atol=1e-9)
    fall = found.A * found.bound**2 * share * (1 - share)
    np.testing.assert_allclose(found.theta - inside.theta, fall, rtol=1e-6, atol=1e-9)
    np.testing.assert_array_equal(found.bound > 0, found.B < 0)


@given(PAIRS, PAIRS, st.floats(0.01, 5))
def test_printed_A_and_B_hold_lambda_and_the_wrong_sign(of_t, of_beta, gain):
    """Word by word: De_t = -lambda H, De_beta = -lambda R; H = -d_t and R = d_beta."""
    (e_t, d_t), (e_beta, d_beta) = (tuple(part[:, 0] for part in of) for of in (of_t, of_beta))
    found = printed_of(lyapunov_of(e_t, d_t), lyapunov_of(e_beta, d_beta), gain)
    H, R = -d_t, d_beta
    De_t, De_beta = -gain * H, -gain * R
    np.testing.assert_allclose(found.A, De_t @ De_t + De_beta @ De_beta, atol=1e-9)
    np.testing.assert_allclose(found.B, e_t @ De_t + e_beta @ De_beta, atol=1e-9)
    np.testing.assert_allclose(found.theta, 0.5 * (e_t @ e_t + e_beta @ e_beta), atol=1e-9)


def test_the_printed_33_asks_lambda_of_itself():
    """|B/A| as printed falls as 1/lambda: it holds the lambda that it is to bound."""
    t, beta = Lyapunov(1.0, 2.0, -3.0), Lyapunov(1.0, 1.0, 0.5)
    bounds = [abs(printed_of(t, beta, gain).bound) for gain in (0.1, 0.2, 0.4)]
    np.testing.assert_allclose(np.multiply(bounds, [0.1, 0.2, 0.4]), bounds[0] * 0.1)
