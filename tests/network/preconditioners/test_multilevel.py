"""The pyramid: hats, their transposes, and what it leaves alone."""

from dataclasses import replace

import numpy as np
import pytest
from designs import coordinated, designed, near_start
from hypothesis import given, settings, strategies as st

from ann_dc.analysis.linearisation import Linearisation
from ann_dc.errors import NetworkError
from ann_dc.evaluation.reference import evaluator
from ann_dc.gain_design.gain_rule import GainRule, closed_form
from ann_dc.gain_design.gains import apply_gains
from ann_dc.network.preconditioners.base import PreconditionerKind
from ann_dc.network.preconditioners.multilevel import Multilevel, hat_positions
from ann_dc.problem import plants
from ann_dc.solver import synthesize


def hat_matrix(count: int, intervals: int) -> np.ndarray:
    """(count, intervals + 1): hat functions of a grid over 0..1 at ``count`` places, textbook."""
    places, centres = np.linspace(0, 1, count), np.linspace(0, 1, intervals + 1)
    return np.maximum(0, 1 - np.abs(places[:, None] - centres) * intervals)


@st.composite
def pyramids(draw) -> tuple[Multilevel, int]:
    """Random coordinators with positive semi-definite gains, and a number of positions."""
    stages, chains = draw(st.integers(1, 20)), draw(st.integers(1, 4))
    levels = draw(st.integers(1, max(1, int(np.log2(max(2 * stages - 1, 2))))))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    gains = []
    for level in range(levels, 0, -1):
        root = rng.standard_normal((2**level + 1, chains, chains))
        gains.append(root @ root.transpose(0, 2, 1))
    return Multilevel(gains=tuple(gains)), 2 * stages


@settings(max_examples=40, deadline=None)
@given(pyramids())
def test_the_pyramid_is_a_sum_over_grids(case):
    coordinators, count = case
    chains = coordinators.chains
    expected = np.zeros((chains * count, chains * count))
    for gain in coordinators.gains:
        hats = hat_matrix(count, len(gain) - 1)
        for a, S in enumerate(gain):
            expected += np.kron(S, np.outer(hats[:, a], hats[:, a]))
    scale = np.abs(expected).max()
    unit = np.eye(chains * count).reshape(-1, chains, count)
    preconditioner = coordinators.spread(unit).reshape(len(unit), -1).T
    np.testing.assert_allclose(preconditioner, expected, atol=1e-12 * scale)
    np.testing.assert_allclose(preconditioner, preconditioner.T, atol=1e-13 * scale)
    drive = np.random.default_rng(0).standard_normal((3, chains, count))
    np.testing.assert_allclose(
        coordinators.spread(drive).reshape(3, -1),
        drive.reshape(3, -1) @ preconditioner.T,
        atol=1e-12 * scale,
    )


@given(st.integers(2, 200), st.integers(0, 6))
def test_hats(count, level):
    intervals = 1 << level
    left, share = hat_positions(count, intervals)
    hats = np.zeros((count, intervals + 1))
    hats[np.arange(count), left] += 1 - share
    hats[np.arange(count), left + 1] += share
    np.testing.assert_allclose(hats, hat_matrix(count, intervals), atol=1e-9)
    np.testing.assert_allclose(hats.sum(axis=1), 1.0)
    np.testing.assert_allclose([hats[0, 0], hats[-1, -1]], 1.0, rtol=1e-12)


@pytest.mark.sampled(4)
@pytest.mark.parametrize("stages", [2, 3, 8, 9, 20])
@pytest.mark.parametrize(
    "kind", [PreconditionerKind.MULTILEVEL, PreconditionerKind.COUPLED_MULTILEVEL]
)
def test_number_of_neurons(stages, kind):
    network = synthesize(plants.car(N=stages, dt=0.9 / stages))
    linear = Linearisation(network).at(network.start_state)
    coordinators = closed_form(linear, GainRule(kind=kind)).preconditioner
    levels = int(np.log2(2 * stages - 1))
    assert len(coordinators.gains) == levels
    # both ends of the chain are fixed, so a grid of 2^j intervals has 2^j - 1 inner points
    assert coordinators.size == 4 * sum(2**j - 1 for j in range(1, levels + 1))
    for gain in coordinators.gains:
        assert not gain[[0, -1]].any()
        assert np.linalg.eigvalsh(gain).min() > -1e-12 * gain.max()


def test_a_free_end_has_a_coordinator():
    problem = plants.unicycle(N=6, q_d=(2, 1, None))
    network = synthesize(problem)
    assert network.chain_live[:, -1].tolist() == [False, False, True]
    gains = closed_form(Linearisation(network).at(network.start_state), GainRule())
    moved = apply_gains(network, gains).preconditioner.gains[0][-1]
    assert moved.any()
    frozen = apply_gains(network, gains)
    x = near_start(frozen, 0)
    np.testing.assert_allclose(
        evaluator(frozen).rhs(x),
        evaluator(frozen).preconditioner @ network.pack(evaluator(frozen).drives(x)),
        atol=1e-12,
    )


def test_a_row_too_short_has_none():
    network = synthesize(plants.double_integrator(N=1))
    assert (
        closed_form(Linearisation(network).at(network.start_state), GainRule()).preconditioner.kind
        is PreconditionerKind.DIAGONAL
    )


def test_no_equilibrium_changes():
    design = designed("car")
    assert design.network.preconditioner.kind is not PreconditionerKind.DIAGONAL
    drives = design.network.pack(evaluator(design.network).drives(design.state))
    assert np.abs(drives).max() < 1e-6 * np.abs(design.state).max()
    assert (
        np.abs(evaluator(design.network).rhs(design.state)).max()
        < 1e-6 * np.abs(design.state).max()
    )
    # and none is added: the preconditioner is regular
    assert np.linalg.cond(evaluator(design.network).preconditioner.toarray()) < 1e6


def test_wires_touch_live_neurons_under_a_hat():
    network = coordinated("car")
    live = network.chain_live
    expected = 0
    for gain in network.preconditioner.gains:
        inner = hat_matrix(live.shape[1], len(gain) - 1)[:, 1:-1] > 1e-12
        expected += (live.astype(int) @ inner).sum()
    assert network.preconditioner.wires(network.layout).count == expected


@pytest.mark.parametrize("points", [[5, 5], [3, 5], [1], [9, 3]])
def test_levels_that_do_not_nest(points):
    with pytest.raises(NetworkError, match="half the intervals"):
        Multilevel(gains=tuple(np.ones((p, 2, 2)) for p in points))


@pytest.mark.parametrize("points", [[4, 2], [6, 3]])
def test_odd_levels_are_refused(points):
    with pytest.raises(NetworkError, match="half the intervals"):
        Multilevel(gains=tuple(np.ones((p, 2, 2)) for p in points))


def test_no_levels_are_refused():
    with pytest.raises(NetworkError, match="expected one level or more, got none"):
        Multilevel(gains=())


def test_gains_of_another_plant():
    network = coordinated("car")
    wrong = Multilevel(gains=(np.ones((3, 2, 2)),))
    with pytest.raises(NetworkError, match="made for 2 chains"):
        evaluator(replace(network, preconditioner=wrong)).rhs(network.start_state)


def test_gains_that_are_not_square():
    with pytest.raises(NetworkError, match="does not fit"):
        Multilevel(gains=(np.ones((5, 2, 2)), np.ones((3, 2, 1))))


def with_block(block) -> tuple[np.ndarray, np.ndarray]:
    """Two levels of ones, the second with another matrix at its middle grid point."""
    fine, coarse = (np.broadcast_to(np.eye(2), (points, 2, 2)).copy() for points in (5, 3))
    coarse[1] = block
    return fine, coarse


@pytest.mark.parametrize("scale", [1e-8, 1.0, 1e8])
@pytest.mark.parametrize(
    ("block", "says"),
    [
        ([[1.0, 0.0], [0.0, -0.1]], "the eigenvalue -"),
        ([[1.0, 2.0], [2.0, 1.0]], "the eigenvalue -"),
        ([[0.0, 0.5], [0.5, 0.0]], "the eigenvalue -"),
        ([[1.0, 0.5], [0.0, 1.0]], "an unsymmetric one"),
    ],
)
def test_gains_that_are_not_semi_definite_are_told_by_their_place(block, says, scale):
    with pytest.raises(NetworkError, match=f"level 1, grid point 1 of 0 to 2: .* got {says}"):
        Multilevel(gains=with_block(scale * np.array(block)))


@pytest.mark.parametrize("scale", [1e-300, 1.0, 1e100])
@pytest.mark.parametrize(
    "block",
    [
        [[0.0, 0.0], [0.0, 0.0]],
        [[1.0, 1.0], [1.0, 1.0]],  # of rank one
        [[1.0, 1.0], [1.0, 1.0 - 1e-7]],  # and rounded to single precision
        [[1.0, 0.0], [0.0, -1e-7]],
        [[1.0, 0.5 + 1e-7], [0.5, 1.0]],
    ],
)
def test_semi_definite_gains_may_be_rounded(block, scale):
    assert Multilevel(gains=with_block(scale * np.array(block))).chains == 2
