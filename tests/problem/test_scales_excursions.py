"""How far states stray, against the dense conditional Gaussian that the recursion stands for."""

import numpy as np
import pytest
from hypothesis import assume, given, settings, strategies as st
from scipy.linalg import null_space

from ann_dc.problem.scales import bridge_variance

BRIDGES = st.tuples(
    st.integers(1, 3), st.integers(1, 2), st.integers(3, 7), st.integers(0, 2**32 - 1)
)


def bridge(n, m, stages, seed):
    """F, B, Q, R and which ends are held, at random; all but the last state may be held."""
    rng = np.random.default_rng(seed)
    F = np.eye(n)[:, :, None] + 0.5 * rng.standard_normal((n, n, stages))
    B = rng.standard_normal((n, m, stages))
    Q = rng.uniform(0.0, 2.0, (n, stages + 1)) * rng.integers(0, 2, (n, 1))
    return F, B, Q, 10 ** rng.uniform(-2, 2, m), rng.integers(0, 2, n).astype(bool)


def states_by_controls(F, B):
    """L (N, n, N m): q_k = L_k u from q_0 = 0."""
    n, m, stages = B.shape
    by_controls, reach = [], np.zeros((n, stages, m))
    for k in range(stages):
        reach = np.einsum("ij,jkl->ikl", F[:, :, k], reach)
        reach[:, k] += B[:, :, k]
        by_controls.append(reach.reshape(n, -1))
    return np.array(by_controls)


def held_variance(L, price, Q, fixed):
    """Variance (n, N) of a Gaussian with precision P whose ends are held: Z (Z'PZ)^-1 Z'.

    An end is held 1e8 times stiffer than it can be moved, not rigidly: one that can hardly be
    moved beside the others is left out, since there the two are not the same.
    """
    precision = np.diag(price) + np.einsum("kia,ik,kib->ab", L, Q[:, 1:], L)
    Z = np.eye(len(precision))
    if fixed.any():
        moves = L[-1][fixed] @ np.linalg.solve(precision, L[-1][fixed].T)
        size = np.sqrt(((L[-1][fixed] / np.sqrt(price)) ** 2).sum(axis=1))
        assume(np.linalg.eigvalsh(moves / np.outer(size, size))[0] > 1e-2)
        Z = null_space(L[-1][fixed])
    return np.einsum("kia,ab,kib->ik", L, Z @ np.linalg.solve(Z.T @ precision @ Z, Z.T), L)


def conditional_variance(F, B, Q, R, fixed):
    """The same where the controls alone are unknown."""
    return held_variance(states_by_controls(F, B), np.tile(R, B.shape[-1]), Q, fixed)


@settings(max_examples=60, deadline=None)
@given(BRIDGES)
def test_it_is_the_variance_of_the_dense_gaussian(sizes):
    F, B, Q, R, fixed = bridge(*sizes)
    given = bridge_variance(F, B, Q, R, fixed)
    dense = conditional_variance(F, B, Q, R, fixed)
    free = conditional_variance(F, B, 0 * Q, R, np.zeros_like(fixed))
    np.testing.assert_allclose(given / free.max(), dense / free.max(), atol=1e-5)
    assert (given[fixed, -1] == 0).all()
    assert (given >= 0).all()


@settings(max_examples=20, deadline=None)
@given(BRIDGES, st.integers(0, 2**32 - 1))
def test_it_is_written_in_the_units_of_the_states(sizes, seed):
    n, m, *_ = sizes
    F, B, Q, R, fixed = bridge(*sizes)
    rng = np.random.default_rng(seed)
    state, control, cost = (10 ** rng.uniform(-6, 6, size) for size in (n, m, None))
    other = bridge_variance(
        F / state[:, None, None] * state[:, None],
        B / state[:, None, None] * control[:, None],
        Q * state[:, None] ** 2 / cost,
        R * control**2 / cost,
        fixed,
    )
    own = bridge_variance(F, B, Q, R, fixed)
    largest = own.max(axis=1, keepdims=True)
    size = np.where(largest > 0, largest, 1.0)
    np.testing.assert_allclose(other * (state**2)[:, None] / cost / size, own / size, atol=1e-7)


@settings(max_examples=20, deadline=None)
@given(BRIDGES, st.permutations(range(3)))
def test_no_state_comes_first(sizes, order):
    F, B, Q, R, fixed = bridge(*sizes)
    order = [i for i in order if i < sizes[0]]
    turned = bridge_variance(F[order][:, order], B[order], Q[order], R, fixed[order])
    own = bridge_variance(F, B, Q, R, fixed)[order]
    np.testing.assert_allclose(turned, own, rtol=1e-6, atol=1e-9 * own.max())


def test_a_state_that_no_control_moves_stays():
    """The second one only decays; that its end is held is nothing that controls could answer."""
    F = np.repeat(np.diag([1.0, 0.5])[:, :, None], 4, axis=2)
    B = np.repeat(np.array([[1.0], [0.0]])[:, :, None], 4, axis=2)
    variance = bridge_variance(F, B, np.zeros((2, 5)), np.ones(1), np.array([True, True]))
    np.testing.assert_allclose(variance[0], [0.75, 1.0, 0.75, 0.0], rtol=1e-6)
    assert (variance[1] == 0).all()


@pytest.mark.parametrize("held", [True, False])
@pytest.mark.parametrize("growth", [1.2, 3.0])
def test_an_unstable_plant_over_500_stages(growth, held):
    """Stationary in the middle: q' = a q + u with feedback (a - 1/a) strays by 1 / (a^2 - 1)
    before what is left of its control costs: G = 1/a, share = 1/a^2."""
    one = np.ones((1, 1, 500))
    variance = bridge_variance(
        growth * one, one, np.full((1, 501), 1e-9), np.ones(1), np.array([held])
    )
    assert np.isfinite(variance).all()
    share = 1 / growth**2
    np.testing.assert_allclose(variance[0, 50:400], share / (1 - share), rtol=1e-6)


def dense_with_loose_start(F, B, Q, R, fixed, loose):
    """The same where some components of q_0 are further unknowns, before the controls."""
    n, stages = len(F), B.shape[-1]
    from_start, after = [], np.eye(n)
    for k in range(stages):
        after = F[:, :, k] @ after
        from_start.append(after[:, loose])
    L = np.concatenate([np.array(from_start), states_by_controls(F, B)], axis=-1)
    return held_variance(L, np.concatenate([Q[loose, 0], np.tile(R, stages)]), Q, fixed)


@settings(max_examples=40, deadline=None)
@given(BRIDGES, st.integers(0, 2**32 - 1))
def test_a_free_start_is_part_of_the_dense_gaussian(sizes, seed):
    F, B, Q, R, fixed = bridge(*sizes)
    rng = np.random.default_rng(seed)
    loose = rng.integers(0, 2, len(fixed)).astype(bool)
    Q[:, 0] = rng.uniform(0.5, 2.0, len(Q))  # every start has a price
    given = bridge_variance(F, B, Q, R, fixed, loose)
    dense = dense_with_loose_start(F, B, Q, R, fixed, loose)
    free = conditional_variance(F, B, 0 * Q, R, np.zeros_like(fixed))
    size = max(dense.max(), free.max())
    np.testing.assert_allclose(given / size, dense / size, atol=1e-5)


def test_a_chain_may_be_read_backwards():
    one, nothing = np.ones((1, 1, 4)), np.zeros((1, 5))
    held, free = np.array([True]), np.array([False])
    forth = bridge_variance(one, one, nothing, np.ones(1), free)
    back = bridge_variance(one, one, nothing, np.ones(1), held, loose=held)
    assert forth[0] == pytest.approx([1, 2, 3, 4])
    assert back[0] == pytest.approx([3, 2, 1, 0])


def test_where_no_cost_tells_how_far_a_start_may_go():
    one = np.ones((1, 1, 4))
    free = np.array([False])
    assert np.isinf(bridge_variance(one, one, np.zeros((1, 5)), np.ones(1), free, ~free)).all()


def test_a_map_that_explodes_counts_as_one_that_keeps_what_it_has():
    """Growth by 1e120 says nothing of a path: Monod kinetics in long Euler steps did that."""
    one, nothing, free = np.ones((1, 1, 40)), np.zeros((1, 41)), np.array([False])
    exploding = bridge_variance(1e3 * one, one, nothing, np.ones(1), free)
    assert exploding[0] == pytest.approx(np.arange(1, 41))
    growing = bridge_variance(1.5 * one, one, nothing, np.ones(1), free)
    assert growing[0, -1] > 1e12
