"""Elimination against a dense solve, over rows of blocks of every length."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg
from designs import wired_with
from hypothesis import given, settings, strategies as st
from problems import SUITE
from random_preconditioners import random_blocks, rows, tridiagonal

from ann_dc.network.preconditioners.base import ArrayLayout, PreconditionerKind
from ann_dc.network.preconditioners.cyclic_reduction import CyclicReduction
from ann_dc.network.preconditioners.elimination import eliminate

seeds = st.integers(0, 2**32 - 1)


def of_cells(blocks: int, size: int) -> ArrayLayout:
    """A row whose cells are primal neurons without chains: every cell is one block."""
    return ArrayLayout(
        rates=np.ones((size, blocks)), primal=np.arange(size), chains=np.zeros((0, 2), int)
    )


@settings(max_examples=60, deadline=None)
@given(blocks=st.integers(1, 20), size=st.integers(1, 4), seed=seeds)
def test_it_solves(blocks, size, seed):
    rng = np.random.default_rng(seed)
    own, following = random_blocks(rng, blocks, size)
    found = eliminate(CyclicReduction(own=own, following=following), of_cells(blocks, size))
    drives = rng.standard_normal((blocks, size, 3))
    expected = scipy.linalg.solve(
        tridiagonal(own, following), drives.reshape(-1, 3), assume_a="pos"
    )
    np.testing.assert_allclose(found.solve(drives).reshape(-1, 3), expected, atol=1e-11)
    one = found.solve(drives[..., 0] + 1j * drives[..., 1]).ravel()
    np.testing.assert_allclose(one, expected[:, 0] + 1j * expected[:, 1], atol=1e-11)


@pytest.mark.parametrize("blocks", [1, 2, 3, 4, 7, 8, 9, 1000])
def test_levels(blocks):
    """Halves, rounded down, until one block is left."""
    own, following = random_blocks(np.random.default_rng(0), blocks, 2)
    found = eliminate(CyclicReduction(own=own, following=following), of_cells(blocks, 2))
    assert len(found.levels) == int(np.log2(blocks)) + 1
    rest = blocks
    for level in found.levels:
        gone = rest - rest // 2
        assert level.inverse.shape == (gone, 2, 2)
        assert level.left.shape == (rest // 2, 2, 2)
        assert level.right.shape == (gone - 1, 2, 2)
        rest //= 2
    assert rest == 0


def test_a_chain_of_springs_in_closed_form():
    """Own 2, following -1, as many cells as springs: S^{-1} of three is known by heart."""
    own, following = np.full((3, 1, 1), 2.0), np.full((2, 1, 1), -1.0)
    found = eliminate(CyclicReduction(own=own, following=following), of_cells(3, 1))
    expected = np.array([[3.0, 2.0, 1.0], [2.0, 4.0, 2.0], [1.0, 2.0, 3.0]]) / 4
    np.testing.assert_allclose(found.solve(np.eye(3)[:, None])[:, 0], expected, rtol=1e-14)
    np.testing.assert_allclose(found.levels[0].left, [[[-0.5]]])  # half of either neighbour
    np.testing.assert_allclose(found.levels[0].right, [[[-0.5]]])


@pytest.mark.parametrize("name", SUITE)
def test_a_plant_has_two_blocks_a_cell(name):
    """t_k alone is tied to the next cell, so that q_k, u_k and t_k may be eliminated in turn."""
    network = wired_with(name, PreconditionerKind.CYCLIC_REDUCTION)
    found, row = network.preconditioner.elimination(network.layout), network.layout
    chains = len(row.chains)
    assert len(found.component) == 2 * row.stages
    assert found.component.shape[1] == max(len(row.primal) - chains, chains)
    places = found.component[found.component >= 0]
    np.testing.assert_array_equal(np.sort(places), np.sort(_components(row)))


def test_what_ties_other_neurons_too_stays_whole():
    network = wired_with("car", PreconditionerKind.CYCLIC_REDUCTION)
    following = network.preconditioner.following.copy()
    following[1, 0, 0] = 0.01
    found = replace(network.preconditioner, following=following).elimination(network.layout)
    assert found.component.shape == (network.stages, len(network.layout.primal))


@settings(max_examples=40, deadline=None)
@given(row=rows(), seed=seeds)
def test_neurons_that_are_not_there_stay_out(row, seed):
    """Pinned or absent ones have no component, and nothing flows through them."""
    own, following = random_blocks(np.random.default_rng(seed), row.stages, len(row.primal))
    stiffness = CyclicReduction(own=own, following=following)
    found = eliminate(stiffness, row)
    places = found.component[found.component >= 0]
    np.testing.assert_array_equal(np.sort(places), np.sort(_components(row)))
    drives = np.zeros(len(row.state_rates))
    drives[places] = np.random.default_rng(seed).standard_normal(len(places))
    solved = found.solve(np.where(found.component >= 0, drives[found.component], 0.0))
    assert not solved[found.component < 0].any()
    matrix = stiffness.matrix(row).toarray()[places][:, places]
    expected = np.linalg.solve(matrix, drives[places])
    np.testing.assert_allclose(solved[found.component >= 0], expected, atol=1e-11)


def _components(row: ArrayLayout) -> np.ndarray:
    components = row.component[row.primal].ravel()
    return components[components >= 0]
