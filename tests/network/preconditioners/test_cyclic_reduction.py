"""The feed-forward tree: the moves of the grid, by wires without a loop."""

import numpy as np
import pytest
from designs import wired_with
from hypothesis import given, settings, strategies as st
from problems import SUITE
from random_preconditioners import random_blocks, rows, tridiagonal
from scipy import sparse

from ann_dc.network.preconditioners.base import ArrayLayout, PreconditionerKind
from ann_dc.network.preconditioners.cyclic_reduction import CyclicReduction

seeds = st.integers(0, 2**32 - 1)


def by_wires(tree: CyclicReduction, row: ArrayLayout, drives: np.ndarray) -> np.ndarray:
    """S^{-1} d (n,) as the wires build it: level by level down, the same wires back up."""
    weights, found = sparse.csr_array(tree.wires(row).weights), tree.elimination(row)
    own = {}
    place = found.component
    for level in found.levels:
        for block, inverse in zip(place[0::2], level.inverse):
            for i, j in zip(*np.nonzero((block[:, None] >= 0) & (block >= 0))):
                value = inverse[i, j] if i == j else weights[min_max(block, i, j)]
                own[block[i], block[j]] = value
        place = place[1::2]
    gone = [level_place[level_place >= 0] for level_place in _levels(found)]
    rest, derivatives = drives.astype(float).copy(), np.zeros(len(drives))
    for eliminated, remaining in zip(gone, _remaining(gone)):
        rest[remaining] += weights[eliminated][:, remaining].T @ rest[eliminated]
    for eliminated, remaining in reversed(list(zip(gone, _remaining(gone)))):
        table = np.array([[own.get((i, j), 0.0) for j in eliminated] for i in eliminated])
        derivatives[eliminated] = table @ rest[eliminated]
        derivatives[eliminated] += weights[eliminated][:, remaining] @ derivatives[remaining]
    return derivatives


def min_max(block, i, j) -> tuple[int, int]:
    """Couplings within a block stand above its diagonal."""
    return (block[min(i, j)], block[max(i, j)])


def _levels(found) -> list[np.ndarray]:
    levels, place = [], found.component
    for _ in found.levels:
        levels.append(place[0::2].ravel())
        place = place[1::2]
    return levels


def _remaining(gone: list[np.ndarray]) -> list[np.ndarray]:
    return [np.concatenate([np.zeros(0, int), *gone[k + 1 :]]) for k in range(len(gone))]


@settings(max_examples=30, deadline=None)
@given(row=rows(), seed=seeds)
def test_wires_are_the_inverse_of_the_stiffness(row, seed):
    """No part of M is missing in the wires: feed-forward sums alone solve S z = d."""
    rng = np.random.default_rng(seed)
    own, following = random_blocks(rng, row.stages, len(row.primal))
    tree = CyclicReduction(own=own, following=following)
    place = row.component[row.primal].T.ravel()
    used = place[place >= 0]
    drives = np.zeros(len(row.state_rates))
    drives[used] = rng.standard_normal(len(used))
    matrix = tree.matrix(row).toarray()
    expected = np.linalg.solve(matrix, drives)
    np.testing.assert_allclose(by_wires(tree, row, drives)[used], expected[used], atol=1e-10)


@settings(max_examples=30, deadline=None)
@given(stages=st.integers(1, 20), seed=seeds)
def test_hats_are_harmonic(stages, seed):
    """An eliminated neuron answers its neighbours' moves so that nothing is left to drive it."""
    own, following = random_blocks(np.random.default_rng(seed), stages, 1)
    row = ArrayLayout(
        rates=np.ones((1, stages)), primal=np.array([0]), chains=np.zeros((0, 2), int)
    )
    hats = CyclicReduction(own=own, following=following).wires(row).weights.toarray()
    whole = tridiagonal(own, following)
    for k in range(0, stages, 2):
        if stages > 1:
            np.testing.assert_allclose(hats[k] * whole[k, k], -np.where(
                np.arange(stages) == k, 0.0, whole[k]), atol=1e-12)  # fmt: skip


@pytest.mark.sampled(7)
@pytest.mark.parametrize("name", SUITE)
def test_wires_of_every_plant(name):
    network = wired_with(name, PreconditionerKind.CYCLIC_REDUCTION)
    wires, row = network.preconditioner.wires(network.layout), network.layout
    first, second = wires.weights.nonzero()
    reached = network.preconditioner.reach(row)[network.places[:, 0]]
    assert reached[first].all()
    assert reached[second].all()
    assert wires.both_ways
    assert wires.nodes == (network.preconditioner.elimination(row).component[1::2] >= 0).sum()
    assert not wires.weights.diagonal().any()


def test_it_reaches_across_the_row():
    """Twice as far at every level: the last block is tied to others half a row away."""
    own, following = random_blocks(np.random.default_rng(1), 16, 1)
    row = ArrayLayout(rates=np.ones((1, 16)), primal=np.array([0]), chains=np.zeros((0, 2), int))
    first, second = CyclicReduction(own=own, following=following).wires(row).weights.nonzero()
    assert set(np.abs(first - second)) == {1, 2, 4, 8}
