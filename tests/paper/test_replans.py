"""The plans of Figure 6: their starts, their solutions, and what (33) makes of them."""

from functools import cache

import numpy as np
import pytest
from car_by_hand import DT, A
from closed_chains import CAR, closed_chain
from reference import ipopt

from ann_dc.evaluation.populations import neuron_values
from ann_dc.paper.replans import CASES, Case, iterations, one_gain, replanned, to_the_letter
from ann_dc.problem import plants
from ann_dc.two_level.upper_gains import UpperMap

ONE = Case(name="one obstacle", stages=(4,))


@cache
def planned():
    return replanned(closed_chain(CAR), CAR, ONE)


def test_the_cases_are_those_of_the_figure():
    assert [len(case.stages) for case in CASES] == [4, 3]


@pytest.mark.slow
def test_a_plan_starts_beside_its_obstacle():
    optimum = ipopt(CAR)
    starts = planned().starts
    np.testing.assert_allclose(starts[0], CAR.q_0, atol=1e-6)
    np.testing.assert_allclose(starts[1], optimum.q[:, 4] + ONE.delta, atol=1e-5)


@pytest.mark.slow
def test_every_plan_has_the_solution_that_33_asks_for():
    """One frozen network, two starts: IPOPT finds no better plan from either."""
    for start, x in zip(planned().starts, planned().newton.states):
        network = closed_chain(CAR).network
        given = {f"q_0.{s}": float(v) for s, v in zip(CAR.states, start)}
        u = neuron_values(network.with_inputs(given), x)["u"]
        objective = 0.5 * float((u**2).sum())
        best = ipopt(plants.car(q_0=tuple(start))).objective
        assert objective == pytest.approx(best, rel=1e-6)


@pytest.mark.slow
def test_lambda_is_half_of_the_quotient():
    run = planned().run
    found = run.lyapunov
    np.testing.assert_allclose(
        run.gains[:, 0], 0.5 * np.abs(found.B / found.A)[:-1].clip(0, 2e3), rtol=1e-12
    )
    assert not run.settled.any()


def test_to_the_letter_no_stage_knows_the_map():
    """mu_k = beta_{k+1}, q_k = t_{k-1} / 0.99: every lambda lets t and beta drive each other."""
    run = to_the_letter(CAR, closed_chain(CAR).state)
    values = neuron_values(closed_chain(CAR).network, run.states[0])
    np.testing.assert_allclose(values["mu"][:-1], values["beta"][1:], rtol=1e-6)
    np.testing.assert_allclose(values["q"][1:], values["t"][:-1] / A, rtol=1e-6)
    np.testing.assert_allclose(values["u"][:, 1], values["mu"][:, 3] / DT, rtol=1e-6)
    assert run.lyapunov.theta[-1] > 1e6 * run.lyapunov.theta[0]
    assert not run.settled.any()


def test_one_gain_is_among_the_good_ones():
    found = closed_chain(CAR)
    gain = one_gain(found.network, found.state)
    assert gain.lambda_t == gain.lambda_beta
    upper = UpperMap(network=found.network, settled=found.state)
    own = upper.radius(gain.lambda_t, gain.lambda_beta)
    assert own < 1
    assert all(own <= upper.radius(g, g) + 1e-9 for g in gain.lambda_t * np.array([0.5, 2.0]))


@pytest.mark.slow
def test_everything_that_is_said_of_the_two_levels():
    found = iterations()
    theta, gain = found.common.lyapunov.theta[:, 0], found.common.gains[:, 0, 0]
    true, printed = found.common.lyapunov, found.common.printed_lyapunov
    did = np.diff(theta)
    np.testing.assert_allclose(true.A[:-1, 0] * gain**2 + true.B[:-1, 0] * gain, did, rtol=1e-6)
    foretold = printed.A[:, 0] * gain**2 + printed.B[:, 0] * gain
    assert np.abs(foretold - did).max() > 0.5 * np.abs(did).max()
    distances = found.gradient.distances
    assert (distances.v[-20:] <= found.following.v * distances.reported[-20:]).all()
    assert (distances.mu[-20:] <= found.following.mu * distances.reported[-20:]).all()
    assert not found.hypothesis.holds
    assert found.printed_hypothesis.holds
