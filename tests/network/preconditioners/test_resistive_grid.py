"""The neighbour grid: its wires are the couplings of S, none longer than to the next cell."""

import numpy as np
import pytest
from designs import wired_with
from hypothesis import given, settings, strategies as st
from problems import SUITE
from random_preconditioners import random_blocks, rows

from ann_dc.network.preconditioners.base import ArrayLayout, PreconditionerKind
from ann_dc.network.preconditioners.resistive_grid import ResistiveGrid


@settings(max_examples=40, deadline=None)
@given(row=rows(), seed=st.integers(0, 2**32 - 1))
def test_wires_are_the_stiffness_beside_its_diagonal(row, seed):
    own, following = random_blocks(np.random.default_rng(seed), row.stages, len(row.primal))
    grid = ResistiveGrid(own=own, following=following)
    wires, matrix = grid.wires(row), grid.matrix(row)
    weights = wires.weights.toarray()
    np.testing.assert_array_equal(
        weights + weights.T + np.diag(matrix.diagonal()), matrix.toarray()
    )
    assert wires.count == (matrix.count_nonzero() - matrix.shape[0]) // 2
    assert (wires.nodes, wires.both_ways) == (0, False)


@pytest.mark.sampled(4)
@pytest.mark.parametrize("name", SUITE)
def test_no_wire_is_longer_than_to_the_next_cell(name):
    network = wired_with(name, PreconditionerKind.RESISTIVE_GRID)
    first, second = network.preconditioner.wires(network.layout).weights.nonzero()
    stage = network.places[:, 1]
    assert np.abs(stage[first] - stage[second]).max() == 1
    reached = network.preconditioner.reach(network.layout)[network.places[:, 0]]
    assert reached[first].all()
    assert reached[second].all()


def test_a_longer_row_has_as_many_wires_a_cell():
    """Made of equal cells: 2 within one, 1 to the next."""
    own = np.array([[1.0, 0.1, 0.2], [0.1, 1.0, 0.0], [0.2, 0.0, 1.0]])
    following = np.zeros((3, 3))
    following[2, 0] = -0.3
    for stages in (2, 20, 200):
        grid = ResistiveGrid(
            own=np.tile(own, (stages, 1, 1)), following=np.tile(following, (stages - 1, 1, 1))
        )
        row = ArrayLayout(
            rates=np.ones((3, stages)), primal=np.arange(3), chains=np.array([[0, 2]])
        )
        grid.check(row)
        assert grid.wires(row).count == 2 * stages + stages - 1
