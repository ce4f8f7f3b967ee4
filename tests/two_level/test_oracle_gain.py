"""The gain (33): what it does to Theta, in outer iterations and in continuous time."""

import numpy as np
import pytest
from closed_chains import CAR, closed_chain, near, two_level
from designs import designed

from ann_dc import solve
from ann_dc.backends.recurrent.backend import RecurrentBackend
from ann_dc.decomposition.form import SWITCHES
from ann_dc.errors import FormError, NetworkError
from ann_dc.evaluation.codegen.evaluator import fast_evaluator
from ann_dc.network.network import COORDINATION
from ann_dc.problem import plants
from ann_dc.two_level.lyapunov import Lyapunov
from ann_dc.two_level.oracle_gain import OracleBackend, OracleGain
from ann_dc.two_level.run import TwoLevelRun
from ann_dc.two_level.upper_level import OracleCoordinator


def oracle_run(share: float, limit: int) -> TwoLevelRun:
    settled = closed_chain(CAR).state
    return two_level(upper=OracleCoordinator(gain=OracleGain(settled=settled, share=share))).run(
        settled=settled, limit=limit
    )


@pytest.mark.parametrize(
    "share", [*(pytest.param(s, marks=pytest.mark.slow) for s in (0.3, 0.5)), 1.0]
)
def test_theta_changes_as_A_and_B_say(share):
    """A lambda^2 + B lambda with lambda = share |B/A|, since the lower level moves no t or beta."""
    run = oracle_run(share, 5 if share == 1.0 else 30)
    theta, A, B = (part[:, 0] for part in run.lyapunov)
    gain = run.gains[:, 0, 0]
    np.testing.assert_array_equal(run.gains[:, 1, 0], gain)
    np.testing.assert_allclose(gain, share * np.abs(B / A)[:-1], rtol=1e-12)
    change = A[:-1] * gain**2 + B[:-1] * gain
    np.testing.assert_allclose(np.diff(theta), change, rtol=1e-6, atol=1e-9 * theta.max())
    expected = np.where(B < 0, share**2 - share, share**2 + share)[:-1] * (B**2 / A)[:-1]
    np.testing.assert_allclose(np.diff(theta), expected, rtol=1e-6, atol=1e-9 * theta.max())


@pytest.mark.slow
def test_half_the_bound_lowers_theta_and_all_of_it_does_not():
    half, whole = oracle_run(0.5, 30).lyapunov, oracle_run(1.0, 1).lyapunov
    falls = half.B[:-1, 0] < 0
    assert falls.sum() > 10
    assert (np.diff(half.theta[:, 0])[falls] < 0).all()
    assert whole.B[0, 0] < 0
    np.testing.assert_allclose(whole.theta[1], whole.theta[0], rtol=1e-12)


def test_printed_A_and_B_of_a_run_are_those_of_its_steps():
    """Read off the moves of t and beta themselves; the printed (20) turns those of beta round."""
    run, network = oracle_run(0.5, 2), closed_chain(CAR).network
    before, after = (oracle_run(0.5, rounds).states[0] for rounds in (1, 2))
    settled, is_t = closed_chain(CAR).state, network.of_population("t")
    slow = network.of_population(*COORDINATION)
    moved = np.where(is_t, after - before, before - after)[slow]
    found = run.printed_lyapunov
    assert found.A.shape == run.gains[:, 0].shape == (2, 1)
    np.testing.assert_allclose(found.A[1, 0], moved @ moved, rtol=1e-9)
    np.testing.assert_allclose(found.B[1, 0], (before - settled)[slow] @ moved, rtol=1e-9)
    gain, change = run.gains[1, 0, 0], np.diff(run.lyapunov.theta[:, 0])[1]
    foretold = found.A[1, 0] * gain**2 + found.B[1, 0] * gain
    assert abs(foretold - change) > 0.1 * abs(change)  # what (21) is for, it does not do


def test_a_batch_may_have_a_solution_for_each():
    settled = closed_chain(CAR).state
    alone = two_level(upper=OracleCoordinator(gain=OracleGain(settled=settled))).run(limit=1)
    both = OracleCoordinator(gain=OracleGain(settled=np.stack([settled, 1.1 * settled])))
    start = closed_chain(CAR).network.start_state
    run = two_level(upper=both).run(np.stack([start, start]), limit=1)
    np.testing.assert_allclose(run.gains[:, :, 0], alone.gains[:, :, 0], rtol=1e-9)
    assert (np.abs(run.gains[:, :, 1] / run.gains[:, :, 0] - 1) > 1e-3).all()


def test_the_oracle_is_the_one_of_the_ode():
    settled = closed_chain(CAR).state
    run = oracle_run(1.0, 0)  # the lower level alone
    network, x = closed_chain(CAR).network, run.states[0]
    slow = network.of_population(*COORDINATION)
    rates = OracleBackend(gain=OracleGain(settled=settled)).right_hand_side(network)(x)
    own = fast_evaluator(network).rhs(x)
    np.testing.assert_array_equal(rates[~slow], own[~slow])
    bound = float(np.abs(run.lyapunov.bound)[0, 0])
    np.testing.assert_allclose(rates[slow], bound * own[slow], rtol=1e-9)


def test_the_oracle_has_a_largest_gain():
    settled = closed_chain(CAR).state
    upper = OracleCoordinator(gain=OracleGain(settled=settled, high=1e-3))
    run = two_level(upper=upper).run(near(CAR, 0.01), limit=2)
    np.testing.assert_array_equal(run.gains, 1e-3)


@pytest.mark.parametrize(
    ("build", "name"),
    [
        (lambda: OracleGain(settled=np.zeros(1), share=np.inf), "share"),
        (lambda: OracleGain(settled=np.zeros(1), high=0.0), "high"),
    ],
)
def test_a_number_out_of_range_is_named(build, name):
    with pytest.raises(NetworkError, match=name):
        build()


def test_the_oracle_gain_is_continuous():
    with pytest.raises(FormError, match=r"S16: .* acts in continuous time; use the ODE backend"):
        solve(plants.car(), form=SWITCHES["S16"], backend=RecurrentBackend())


def test_the_oracle_gain_needs_a_design():
    gains = designed("car").gains
    with pytest.raises(
        FormError, match=r"S16: .* needs the solution, which only a design provides"
    ):
        solve(plants.car(), form=SWITCHES["S16"], gains=gains)


def test_where_it_is_not_defined_the_gain_is_its_least():
    gain = OracleGain(settled=np.zeros(2), low=0.1, high=5.0)
    A, B = np.array([2.0, 0.0, 1.0, 1.0]), np.array([-3.0, 0.0, 0.01, 9.0])
    found = Lyapunov(theta=np.ones(4), A=A, B=B)
    np.testing.assert_array_equal(gain.of(found), [1.5, 0.1, 0.1, 5.0])
