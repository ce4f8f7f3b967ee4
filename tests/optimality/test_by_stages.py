"""The second order by stages against the eigenvalues of one dense matrix, and in closed form."""

from collections import Counter
from dataclasses import replace
from fractions import Fraction
from itertools import product

import numpy as np
import pytest
import scipy.linalg
from other_units import Units, written_in
from points import random_point
from problems import SUITE
from seeds import seeds

from ann_dc.optimality.by_stages import Minimum
from ann_dc.optimality.expansion import Expansion
from ann_dc.optimality.minimum import minimum_by_stages, minimum_of

BORDER = 1e-9
"""Curvature over the largest one below which a random matrix says nothing; of small whole numbers
it is zero there."""


STRICT, FALLING, FLAT = Minimum.STRICT, Minimum.NOT_A_MINIMUM, Minimum.FLAT

both_ways = pytest.mark.parametrize("way", [minimum_of, minimum_by_stages])


def expanded(J, W, end, fixed_start, fixed) -> Expansion:
    """An expansion of which only the second order matters."""
    N, n, z = J.shape
    nothing = np.zeros(n)
    return Expansion(
        fixed_start=np.array(fixed_start), fixed=np.array(fixed), ends=(nothing, nothing),
        state=np.ones(n), cost=1.0, q=np.zeros((N + 1, n)), u=np.zeros((N, z - n)), jacobian=J,
        hessian=W, slope=np.zeros((N, z)), end_hessian=end, end_slope=nothing, mu=np.zeros((N, n)),
        map=np.zeros((n, N)), objective=0.0,
    )  # fmt: skip


def eigenvalues(expansion: Expansion) -> np.ndarray:
    """Of the Hessian in all of (q_0..q_N, u), on the null space of all constraints at once."""
    J, W, (N, n, z) = expansion.jacobian, expansion.hessian, expansion.jacobian.shape
    states = n * (N + 1)
    size = states + N * (z - n)
    H, A = np.zeros((size, size)), np.zeros((n * N, size))
    for k in range(N):
        at = np.r_[n * k : n * (k + 1), states + (z - n) * k : states + (z - n) * (k + 1)]
        H[np.ix_(at, at)] += W[k]
        A[n * k : n * (k + 1), at] = J[k]
        A[n * k : n * (k + 1), n * (k + 1) : n * (k + 2)] = -np.eye(n)
    H[states - n : states, states - n : states] += expansion.end_hessian
    held = np.r_[expansion.fixed_start, np.zeros(n * (N - 1), bool), expansion.fixed]
    A = np.vstack([A / np.linalg.norm(A, axis=1)[:, None], np.eye(size)[:states][held]])
    tangent = scipy.linalg.null_space(A, rcond=1e-11)
    return np.linalg.eigvalsh(tangent.T @ H @ tangent)


def answer(values: np.ndarray, largest: float) -> Minimum:
    if not len(values) or values[0] > BORDER * largest:
        return Minimum.STRICT
    return Minimum.NOT_A_MINIMUM if values[0] < -BORDER * largest else Minimum.FLAT


def sizes(rng):
    n, m, N = int(rng.integers(1, 5)), int(rng.integers(1, 4)), int(rng.integers(1, 7))
    masks = rng.random((2, n)) < rng.choice([0.0, 0.5, 1.0], (2, 1))
    return n, m, N, masks[0], masks[1]


def symmetric(A: np.ndarray) -> np.ndarray:
    return A + A.swapaxes(-1, -2)


@both_ways
def test_random_hessians_of_any_sign(way):
    """Every combination of ends, a thousand points; the two ways have nothing in common."""
    rng, seen = np.random.default_rng(0), Counter()
    for _ in range(1000):
        n, m, N, fixed_start, fixed = sizes(rng)
        J = rng.normal(size=(N, n, n + m))
        W = symmetric(rng.normal(size=(N, n + m, n + m))) / 2 + rng.uniform(-1, 4) * np.eye(n + m)
        end = symmetric(rng.normal(size=(n, n))) / 2 + rng.uniform(-1, 4) * np.eye(n)
        expansion = expanded(J, W, end, fixed_start, fixed)
        values = eigenvalues(expansion)
        largest = np.abs(values).max(initial=0.0)
        if answer(values, largest) is Minimum.FLAT:
            continue
        reported = way(expansion)
        assert reported is answer(values, largest), (J.shape, fixed_start, fixed, values)
        seen[reported] += 1
    assert seen[Minimum.STRICT] > 300
    assert seen[Minimum.NOT_A_MINIMUM] > 300


@pytest.mark.sampled(1)
@both_ways
def test_semidefinite_hessians_and_constraints_that_repeat(way):
    """Small whole numbers, of low rank: flat directions, controls that do the same, or nothing."""
    rng, seen = np.random.default_rng(1), Counter()
    for _ in range(1500):
        n, m, N, fixed_start, fixed = sizes(rng)
        N = min(N, 4)
        J = rng.integers(-1, 2, (N, n, n + m)) * (rng.random((n, n + m)) < 0.7) * 1.0
        root = rng.integers(-1, 2, (N, n + m, int(rng.integers(1, n + m + 1)))) * 1.0
        W = root @ np.diag(rng.choice([1.0, 1.0, 1.0, -1.0], root.shape[2])) @ root.swapaxes(1, 2)
        root = rng.integers(-1, 2, (n, 1)) * 1.0
        expansion = expanded(J, W, root @ root.T, fixed_start, fixed)
        reported = way(expansion)
        assert reported is answer(eigenvalues(expansion), 1.0), (J, W, root, fixed_start, fixed)
        seen[reported] += 1
    assert min(seen[each] for each in (STRICT, FALLING, FLAT)) > 100


@pytest.mark.parametrize("name", ["car", "cart_pole", "lq_unst", "van_der_pol"])
def test_random_points_of_plants(name):
    rng, seen = np.random.default_rng(2), Counter()
    for share in (0.0, 0.3, 0.6):
        problem = SUITE[name].problem.with_horizon(int(rng.integers(5, 10)))
        ends = {
            end: [None if rng.random() < share else value for value in getattr(problem, end)]
            for end in ("q_0", "q_d")
        }
        problem = replace(problem, **ends)
        for pull in np.geomspace(0.01, 100, 12):
            expansion = Expansion.at(problem, *random_point(problem, rng, pull=pull))
            values = eigenvalues(expansion)
            largest = np.abs(values).max()
            if np.abs(values[0]) > 1e-6 * largest:
                reported = minimum_of(expansion)
                assert reported is answer(values, largest), (problem, values)
                seen[reported] += 1
    assert seen.total() > 15


@pytest.mark.sampled(3)
@seeds(3)
@pytest.mark.parametrize("name", ["car", "cart_pole", "pendulum"])
def test_units_do_not_matter(seed, name):
    problem, rng = SUITE[name].problem, np.random.default_rng(seed)
    units = Units.random(problem, seed)
    other = written_in(problem, units)
    for pull in (0.01, 0.3, 3.0, 100.0):
        q, u, mu = random_point(problem, rng, pull=pull)
        reported = minimum_of(Expansion.at(problem, q, u, mu))
        state, control = units.state[:, None], units.control[:, None]
        there = q / state, u / control, mu * state / units.cost
        assert minimum_of(Expansion.at(other, *there)) is reported


# ---- closed forms, long rows -------------------------------------------------------------------


@pytest.mark.parametrize("fixed", [True, False])
@pytest.mark.parametrize("N", [2, 30, 3000])
def test_the_conjugate_point_of_a_long_row(N, fixed):
    """x' = x + a, a^2 - c x^2: the second difference less c, whose ends are held or one is free."""
    critical = 2 - 2 * np.cos(np.pi / N if fixed else np.pi / (2 * N - 1))
    J = np.ones((N, 1, 2))
    for share, expected in ((1 - 1e-5, Minimum.STRICT), (1 + 1e-5, Minimum.NOT_A_MINIMUM)):
        W = np.tile(np.diag([-share * critical, 1.0]), (N, 1, 1))
        assert minimum_of(expanded(J, W, np.zeros((1, 1)), [True], [fixed])) is expected


@pytest.mark.parametrize("N", [3, 300, 3000])
def test_two_controls_that_do_the_same_are_flat(N):
    """x' = x + a + b, (a + b)^2 + x^2."""
    J = np.ones((N, 1, 3))
    W = np.tile(scipy.linalg.block_diag(1.0, np.ones((2, 2))), (N, 1, 1))
    for fixed_start, fixed in product([True, False], repeat=2):
        kind = expanded(J, W, np.zeros((1, 1)), [fixed_start], [fixed])
        assert minimum_of(kind) is Minimum.FLAT


def test_a_falling_cost_far_from_the_end_is_found():
    """One stage of 2000 has the wrong sign, where nothing after it makes good for it."""
    N = 2000
    J, W = np.tile([[1.0, 1.0]], (N, 1, 1)), np.tile(np.eye(2), (N, 1, 1))
    for stage in (0, 7, N - 2):
        turned = W.copy()
        turned[stage, 1, 1] = -2.0
        for fixed in (True, False):
            kinds = (
                expanded(J, W, np.eye(1), [True], [fixed]),
                expanded(J, turned, np.eye(1), [True], [fixed]),
            )
            assert [minimum_of(kind) for kind in kinds] == [
                Minimum.STRICT,
                Minimum.NOT_A_MINIMUM,
            ]


def test_what_is_no_number_is_not_checked():
    J, W, end = np.ones((3, 1, 2)), np.tile(np.eye(2), (3, 1, 1)), np.eye(1)
    for array, bad in product((J, W, end), (np.nan, np.inf)):
        kept = array.copy()
        array.flat[-1] = bad
        assert minimum_of(expanded(J, W, end, [True], [False])) is Minimum.NOT_CHECKED
        array[...] = kept
    assert minimum_of(expanded(J, W, end, [True], [False])) is Minimum.STRICT


@pytest.mark.parametrize("size", [1.0, 30.0, 1e3, 1e4, 1e160])
@pytest.mark.parametrize("fall", [0.0, 1e-7, 1e-3])
def test_large_jacobians_hide_no_falling_direction(size, fall):
    """Where the controls move states far, rounding of A'A is larger than the curvature."""
    for angle in np.linspace(0.1, 1.4, 40):
        along = np.array([np.cos(angle), np.sin(angle)])
        across = np.array([-along[1], along[0]])
        W = np.zeros((1, 3, 3))
        W[0, 0, 0], W[0, 1:, 1:] = 1.0, np.outer(along, along) - fall * np.outer(across, across)
        exact = [[Fraction(w) for w in row] for row in W[0, 1:, 1:].tolist()]
        if exact[0][0] * exact[1][1] - exact[0][1] * exact[1][0] > 0:
            continue  # as rounded, it has a curvature
        J = np.array([[[1.0, *(size * along)]]])
        expansion = expanded(J, W, np.zeros((1, 1)), [True], [False])
        assert minimum_of(expansion) is not Minimum.STRICT
