"""The stiffness between neighbours: what it couples, and what it refuses."""

import re
from dataclasses import replace

import numpy as np
import pytest
from designs import wired_with
from hypothesis import given, settings, strategies as st
from random_preconditioners import random_blocks, rows, tridiagonal

from ann_dc.errors import NetworkError
from ann_dc.evaluation.interpreted import InterpretedEvaluator
from ann_dc.evaluation.reference import evaluator
from ann_dc.network.preconditioners.base import ArrayLayout, PreconditionerKind
from ann_dc.network.preconditioners.cyclic_reduction import CyclicReduction
from ann_dc.network.preconditioners.resistive_grid import ResistiveGrid

seeds = st.integers(0, 2**32 - 1)
both = pytest.mark.parametrize("stiffness", [ResistiveGrid, CyclicReduction])

ROW = ArrayLayout(rates=np.ones((3, 4)), primal=np.array([0, 1]), chains=np.array([[0, 1]]))


def made(stiffness, stages: int = 4, primal: int = 2):
    own, following = random_blocks(np.random.default_rng(0), stages, primal)
    return stiffness(own=own, following=following)


@settings(max_examples=40, deadline=None)
@given(row=rows(), seed=seeds)
def test_the_matrix_is_the_blocks_without_what_is_not_there(row, seed):
    own, following = random_blocks(np.random.default_rng(seed), row.stages, len(row.primal))
    place = row.component[row.primal].T.ravel()
    there = place >= 0
    matrix = ResistiveGrid(own=own, following=following).matrix(row).toarray()
    whole = tridiagonal(own, following)
    np.testing.assert_array_equal(
        matrix[np.ix_(place[there], place[there])], whole[np.ix_(there, there)]
    )
    others = np.setdiff1d(np.arange(len(matrix)), place)
    np.testing.assert_array_equal(matrix[others], np.eye(len(matrix))[others])


@settings(max_examples=30, deadline=None)
@given(row=rows(), seed=seeds)
def test_bands_and_blocks_are_the_same_matrix(row, seed):
    own, following = random_blocks(np.random.default_rng(seed), row.stages, len(row.primal))
    grid = ResistiveGrid(own=own, following=following)
    band, whole = grid.banded(row), tridiagonal(*grid.blocks(row))
    assert band.shape == (2 * len(row.primal), len(whole))
    for below, diagonal in enumerate(band):
        length = len(whole) - below
        if length > 0:
            np.testing.assert_array_equal(diagonal[:length], np.diag(whole, -below))
        assert not diagonal[max(length, 0) :].any()


@both
@settings(max_examples=20, deadline=None)
@given(row=rows(), seed=seeds)
def test_moves_are_a_dense_solve(stiffness, row, seed):
    rng = np.random.default_rng(seed)
    own, following = random_blocks(rng, row.stages, len(row.primal))
    preconditioner = stiffness(own=own, following=following)
    drives = rng.standard_normal(row.rates.shape) * (row.rates > 0)
    root = np.sqrt(row.rates[row.primal]).T.ravel()
    pushed = root * drives[row.primal].T.ravel()
    expected = root * np.linalg.solve(tridiagonal(*preconditioner.blocks(row)), pushed)
    derivatives = preconditioner.apply(row, drives)
    np.testing.assert_allclose(derivatives[row.primal].T.ravel(), expected, atol=1e-10)
    duals = np.setdiff1d(np.arange(len(drives)), row.primal)
    np.testing.assert_array_equal(derivatives[duals], (drives * row.rates)[duals])
    several = preconditioner.apply(
        row, np.stack([drives] * drives.size)
    )  # more than are solved in bands
    np.testing.assert_allclose(several, np.broadcast_to(derivatives, several.shape), atol=1e-10)


@both
def test_a_drive_that_is_no_number_makes_moves_that_are_none(stiffness):
    drives = np.zeros((3, 4))
    drives[0, 1] = np.nan
    assert np.isnan(made(stiffness).apply(ROW, drives)[:2]).any()


WRONG_SHAPES = {
    "a matrix": (np.eye(2), np.zeros((0, 2, 2)), "own: expected an array (N, m, m)"),
    "no square": (np.ones((3, 2, 1)), np.zeros((2, 2, 2)), "own: expected an array (N, m, m)"),
    "no cell": (np.ones((0, 2, 2)), np.zeros((0, 2, 2)), "own: expected an array (N, m, m)"),
    "too many neighbours": (
        np.ones((3, 2, 2)),
        np.zeros((3, 2, 2)),
        "following: expected shape (2, 2, 2), one block per pair of neighbours, got (3, 2, 2)",
    ),
    "other neighbours": (np.ones((3, 2, 2)), np.zeros((2, 1, 2)), "following: expected shape"),
    "not finite": (np.full((1, 1, 1), np.nan), np.zeros((0, 1, 1)), "is not finite"),
    "neighbours not finite": (
        np.ones((2, 1, 1)),
        np.full((1, 1, 1), np.inf),
        "own, following: a stiffness is not finite",
    ),
    "not symmetric": (
        np.array([[[1.0, 0.1], [0.2, 1.0]]]),
        np.zeros((0, 2, 2)),
        "own: the stiffness within a cell must be symmetric",
    ),
}


@both
@pytest.mark.parametrize("case", WRONG_SHAPES)
def test_refused_when_it_is_made(case, stiffness):
    own, following, message = WRONG_SHAPES[case]
    with pytest.raises(NetworkError, match=re.escape(message)):
        stiffness(own=own, following=following)


@both
@pytest.mark.parametrize(("stages", "primal"), [(3, 2), (5, 2), (4, 1), (4, 3)])
def test_a_row_of_another_size(stages, primal, stiffness):
    preconditioner = made(stiffness, stages, primal)
    message = f"made for {stages} cells of {primal} primal neurons, but the network has 4 of 2"
    with pytest.raises(NetworkError, match=message):
        preconditioner.check(ROW)


def test_a_row_without_primal_neurons():
    bare = ArrayLayout(rates=np.ones((1, 2)), primal=np.zeros(0, int), chains=np.zeros((0, 2), int))
    preconditioner = ResistiveGrid(own=np.zeros((2, 0, 0)), following=np.zeros((1, 0, 0)))
    with pytest.raises(NetworkError, match="but the network has 2 of 0"):
        preconditioner.check(bare)


@both
def test_couplings_that_are_too_strong(stiffness):
    own, following = np.broadcast_to(np.eye(2), (4, 2, 2)).copy(), np.zeros((3, 2, 2))
    stiffness(own=own, following=following.copy()).check(ROW)
    following[:, 1, 0] = 1.1
    with pytest.raises(NetworkError, match=r"not positive definite; raise the penalty above rho\*"):
        stiffness(own=own, following=following).check(ROW)


def test_what_is_not_there_cannot_be_too_strong():
    """A coupling to a pinned neuron is not built, so it makes nothing indefinite."""
    own, following = np.broadcast_to(np.eye(2), (4, 2, 2)).copy(), np.zeros((3, 2, 2))
    following[0, 1, 0] = 1.1
    rates = np.ones((3, 4))
    rates[0, 1] = 0.0
    ResistiveGrid(own=own, following=following).check(replace(ROW, rates=rates))


@pytest.mark.parametrize(
    "kind", [PreconditionerKind.RESISTIVE_GRID, PreconditionerKind.CYCLIC_REDUCTION]
)
def test_a_network_refuses_it_when_it_is_evaluated(kind):
    network = wired_with("car", kind)
    preconditioner = replace(network.preconditioner, following=3 * network.preconditioner.following)
    for of in (evaluator, InterpretedEvaluator):
        with pytest.raises(NetworkError, match="not positive definite"):
            of(replace(network, preconditioner=preconditioner))
    preconditioner = replace(
        preconditioner, own=preconditioner.own[1:], following=preconditioner.following[1:]
    )
    with pytest.raises(NetworkError, match="made for 3 cells"):
        evaluator(replace(network, preconditioner=preconditioner))
